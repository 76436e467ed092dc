//! How a law reads its choices from the bytes of an input. Bytes that are missing are zeros, so that
//! every input, and every part of one, is one that can be read.

/// The bytes that are left of an input.
#[derive(Debug, Clone, Copy)]
pub struct Input<'a>(&'a [u8]);

impl<'a> Input<'a> {
    /// Reads from the start.
    pub fn new(bytes: &'a [u8]) -> Self {
        Self(bytes)
    }

    /// Whether nothing is left.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// The next byte.
    pub fn byte(&mut self) -> u8 {
        let Some((&first, rest)) = self.0.split_first() else { return 0 };
        self.0 = rest;
        first
    }

    /// A number below `end`, which is at most 256.
    pub fn below(&mut self, end: usize) -> usize {
        usize::from(self.byte()) % end
    }

    /// Two bytes, little endian.
    pub fn word(&mut self) -> u16 {
        u16::from_le_bytes([self.byte(), self.byte()])
    }

    /// Four bytes, little endian.
    pub fn number(&mut self) -> u32 {
        u32::from(self.word()) | u32::from(self.word()) << 16
    }

    /// Eight bytes, little endian.
    pub fn long(&mut self) -> u64 {
        u64::from(self.number()) | u64::from(self.number()) << 32
    }

    /// A fraction from -1 to 1.
    pub fn fraction(&mut self) -> f64 {
        f64::from(self.word().cast_signed()) / f64::from(i16::MAX)
    }

    /// At most this many of the bytes that are left.
    pub fn take(&mut self, count: usize) -> &'a [u8] {
        let (taken, rest) = self.0.split_at(count.min(self.0.len()));
        self.0 = rest;
        taken
    }

    /// Bytes whose number stands before them, in two bytes.
    pub fn block(&mut self) -> &'a [u8] {
        let count = self.word();
        self.take(count.into())
    }

    /// All that is left.
    pub fn rest(self) -> &'a [u8] {
        self.0
    }
}

/// Appends a [block](Input::block) to a seed. What is longer than a block can be is cut.
pub fn put_block(seed: &mut Vec<u8>, bytes: &[u8]) {
    let count = u16::try_from(bytes.len()).unwrap_or(u16::MAX);
    seed.extend(count.to_le_bytes());
    seed.extend(&bytes[..count.into()]);
}
