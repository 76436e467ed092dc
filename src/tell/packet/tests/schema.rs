//! The shape of all messages, and its hash.

use super::super::*;
use super::*;

#[test]
fn the_schema_hash_is_this_one_and_follows_the_shape() {
    // When this fails, a message has changed its shape, and boxes and hosts
    // must be updated together. Then write the new number here.
    assert_eq!(format!("{SCHEMA_HASH:08x}"), "d7043a3d");

    mod changed {
        use super::*;
        #[derive(Schema)]
        pub struct Base {
            _a: u8,
            _b: Option<[f32; 3]>,
        }
        #[derive(Schema)]
        pub struct Swapped {
            _b: Option<[f32; 3]>,
            _a: u8,
        }
        #[derive(Schema)]
        pub struct Renamed {
            _a: u8,
            _c: Option<[f32; 3]>,
        }
        #[derive(Schema)]
        pub struct Longer {
            _a: u8,
            _b: Option<[f32; 4]>,
        }
        #[derive(Schema)]
        pub struct Wider {
            _a: u16,
            _b: Option<[f32; 3]>,
        }
        #[derive(Schema)]
        pub enum Two {
            _A,
            _B,
        }
        #[derive(Schema)]
        pub enum Three {
            _A,
            _B,
            _C,
        }
    }
    let hashes = [
        schema_hash::<changed::Base>(&[]),
        schema_hash::<changed::Swapped>(&[]),
        schema_hash::<changed::Renamed>(&[]),
        schema_hash::<changed::Longer>(&[]),
        schema_hash::<changed::Wider>(&[]),
        schema_hash::<changed::Two>(&[]),
        schema_hash::<changed::Three>(&[]),
        schema_hash::<changed::Base>(&[1]),
        schema_hash::<changed::Base>(&[2]),
    ];
    for (index, hash) in hashes.iter().enumerate() {
        assert!(!hashes[..index].contains(hash), "{index}");
    }
}

/// The schema is derived from the types, the bytes from their serde
/// implementations; where serde is told to go through a twin, both must name
/// the same one. This walks the schema over the bytes.
#[test]
fn the_schema_describes_the_bytes() {
    for message in longest_messages() {
        let packet = datagram(&message);
        let body = &packet[BODY_AT..packet.len() - 4];
        let mut rest = body;
        walk(Message::SCHEMA.ty, &mut rest);
        assert!(rest.is_empty(), "{} bytes are not in the schema", rest.len());
    }
}

fn take(bytes: &mut &[u8], count: usize) {
    *bytes = &bytes[count..];
}

fn varint(bytes: &mut &[u8]) -> usize {
    let (value, rest) = postcard::take_from_bytes::<u64>(bytes).unwrap();
    *bytes = rest;
    value as usize
}

fn walk(ty: &postcard_schema::schema::DataModelType, bytes: &mut &[u8]) {
    use postcard_schema::schema::{DataModelType as Ty, DataModelVariant as Variant};
    match ty {
        Ty::U8 | Ty::I8 | Ty::Bool => take(bytes, 1),
        Ty::U16 | Ty::U32 | Ty::U64 | Ty::I16 => {
            varint(bytes);
        }
        Ty::F32 => take(bytes, 4),
        Ty::String => {
            let length = varint(bytes);
            take(bytes, length);
        }
        Ty::Option(inner) => {
            let some = bytes[0] == 1;
            take(bytes, 1);
            if some {
                walk(inner.ty, bytes);
            }
        }
        Ty::Seq(inner) => (0..varint(bytes)).for_each(|_| walk(inner.ty, bytes)),
        Ty::Tuple(inner) => inner.iter().for_each(|inner| walk(inner.ty, bytes)),
        Ty::Struct(fields) => fields.iter().for_each(|field| walk(field.ty.ty, bytes)),
        Ty::Enum(variants) => match variants[varint(bytes)].ty {
            Variant::UnitVariant => (),
            Variant::NewtypeVariant(inner) => walk(inner.ty, bytes),
            Variant::TupleVariant(inner) => inner.iter().for_each(|inner| walk(inner.ty, bytes)),
            Variant::StructVariant(fields) => {
                fields.iter().for_each(|field| walk(field.ty.ty, bytes));
            }
        },
        other => panic!("no message uses {other:?} yet"),
    }
}
