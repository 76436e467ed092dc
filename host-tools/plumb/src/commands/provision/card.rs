//! The configuration and the key on a card: the FAT file system from which a box reads them, in an
//! image's file or on the card itself.

use std::fs::{File, OpenOptions};
use std::io::{self, ErrorKind, Read, Seek, SeekFrom, Write};
use std::path::Path;

use fatfs::{Date, DateTime, FileSystem, FsOptions, Time, TimeProvider};
use fscommon::StreamSlice;
use plumbline::config::{BLOB_BYTES_MAX, Config};
use plumbline::config::{FILE_NAME, NEW_FILE_NAME};
use plumbline::seal::{KEY_FILE_NAME, Key, NEW_KEY_FILE_NAME};
use plumbline_bedside::delivery::refuse_another_box;
use plumbline_bedside::keys::{self, Found};
use plumbline_files::BadInput;
use plumbline_update::card::SETTINGS_LABEL;

const SECTOR_BYTES: usize = 512;

/// Of the table in the first sector: where it begins, and the length of each of its four
/// entries.
const TABLE_START: usize = 446;
const ENTRY_BYTES: usize = 16;

/// The types of FAT partitions: FAT12, FAT16 and FAT32 of several ages.
const FAT_TYPES: [u8; 6] = [0x01, 0x04, 0x06, 0x0b, 0x0c, 0x0e];

type Fat<'a> = FileSystem<StreamSlice<&'a File>>;

/// Dates files by this computer's local time.
#[derive(Debug)]
struct Now;

impl TimeProvider for Now {
    fn get_current_date(&self) -> Date {
        self.get_current_date_time().date
    }

    fn get_current_date_time(&self) -> DateTime {
        let now = jiff::Zoned::now();
        // Years of FAT begin in 1980, and nothing here is negative.
        let date = Date {
            year: now.year().unsigned_abs().max(1980),
            month: now.month().unsigned_abs().into(),
            day: now.day().unsigned_abs().into(),
        };
        let time = Time {
            hour: now.hour().unsigned_abs().into(),
            min: now.minute().unsigned_abs().into(),
            sec: now.second().unsigned_abs().into(),
            millis: now.millisecond().unsigned_abs(),
        };
        DateTime { date, time }
    }
}

/// Far more than the text of a key.
const KEY_FILE_BYTES_MAX: u64 = 4096;

/// The key that a card has which is to get this configuration.
///
/// # Errors
/// As [`write()`], before anything is written.
pub fn key(card: &Path, config: &Config, force: bool) -> Result<Found, BadInput> {
    let place = card.display().to_string();
    let file = open(card)?;
    let (fat, _) = file_system(&file, &place)?;
    refuse_another(&fat, &place, config, force)?;
    let found = |name: &str| {
        let bytes = read(&fat, name, KEY_FILE_BYTES_MAX).map_err(|error| fault(&place, &error))?;
        Ok::<_, BadInput>(bytes.map(|bytes| Found::of(&bytes)))
    };
    // As the box sees it after a power cut: what is being written is used where the old is damaged.
    match (found(KEY_FILE_NAME)?, found(NEW_KEY_FILE_NAME)?) {
        (Some(Found::Key(key)), _) | (_, Some(Found::Key(key))) => Ok(Found::Key(key)),
        (Some(unusable), _) => Ok(unusable),
        (None, _) => Ok(Found::Nothing),
    }
}

/// Puts a configuration on a card, and the key if one is given, replacing those that are there. The
/// configuration of another box is kept unless `force`.
///
/// # Errors
/// When there is no FAT file system, it cannot be written to, or the card is another box's.
pub fn write(
    card: &Path,
    config: &Config,
    blob: &[u8],
    key: Option<&Key>,
    force: bool,
) -> Result<(), BadInput> {
    let place = card.display().to_string();
    let file = open(card)?;
    let had_one = {
        let (fat, _) = file_system(&file, &place)?;
        refuse_another(&fat, &place, config, force)?
    };
    let (fat, where_) = file_system(&file, &place)?;
    let text = key.map(keys::file);
    let files = [
        text.as_ref().map(|text| (KEY_FILE_NAME, NEW_KEY_FILE_NAME, text.as_slice())),
        Some((FILE_NAME, NEW_FILE_NAME, blob)),
    ];
    let mut files = files.into_iter().flatten();
    files
        .clone()
        .try_for_each(|(name, new_name, bytes)| replace(&fat, name, new_name, bytes))
        .and_then(|()| fat.unmount())
        .and_then(|()| file.sync_all())
        .map_err(|error| fault(&place, &error))?;
    // A worn-out card may not have kept it.
    let (fat, _) = file_system(&file, &place)?;
    files.try_for_each(|(name, _, bytes)| {
        let there =
            read(&fat, name, BLOB_BYTES_MAX as u64).map_err(|error| fault(&place, &error))?;
        if there.as_deref() == Some(bytes) {
            return Ok(());
        }
        Err(BadInput::whole(&place, "does not keep what is written to it", REPLACE_CARD))
    })?;
    let replaced = if had_one { ", replacing the one before" } else { "" };
    eprintln!("{place}: {FILE_NAME} is {where_}{replaced}");
    Ok(())
}

/// Refuses a card with the configuration of another box, unless `force`; gives whether it has one.
fn refuse_another(
    fat: &Fat<'_>,
    place: &str,
    config: &Config,
    force: bool,
) -> Result<bool, BadInput> {
    let old = read(fat, FILE_NAME, BLOB_BYTES_MAX as u64).map_err(|error| fault(place, &error))?;
    if let Some(old) = old.as_deref().and_then(|old| Config::decode(old).ok()) {
        refuse_another_box(
            place,
            (&old.device, &old.serial_number),
            (&config.device, &config.serial_number),
            force,
        )?;
    }
    Ok(old.is_some())
}

const REPLACE_CARD: &str = "take another card";

/// Opens the image or the card, for this program alone.
fn open(card: &Path) -> Result<File, BadInput> {
    let place = card.display();
    let mut options = File::options();
    options.read(true).write(true);
    alone(&mut options);
    if cfg!(windows) && place.to_string().starts_with(r"\\.\") {
        return Err(BadInput::whole(
            &place,
            "Windows lets programs write to a card's device in whole sectors only",
            format!(
                "its first partition has a letter, such as E: write there, --out E:\\{FILE_NAME}"
            ),
        ));
    }
    options.open(card).map_err(|error| match error.kind() {
        ErrorKind::ResourceBusy => BadInput::whole(
            &place,
            "it is mounted",
            format!("unmount it, or write to the place where it is: --out PLACE/{FILE_NAME}"),
        ),
        ErrorKind::IsADirectory => BadInput::whole(
            &place,
            "is a directory",
            format!("write the file there: --out {place}/{FILE_NAME}"),
        ),
        _ => BadInput::io(&place, &error),
    })
}

/// Of a device that is mounted, the system would overwrite what is written here.
#[cfg(unix)]
fn alone(options: &mut OpenOptions) {
    std::os::unix::fs::OpenOptionsExt::custom_flags(options, libc::O_EXCL);
}

/// Shared with no other program.
#[cfg(windows)]
fn alone(options: &mut OpenOptions) {
    std::os::windows::fs::OpenOptionsExt::share_mode(options, 0);
}

/// The file system that a box would find, and where it is, in words.
fn file_system<'a>(file: &'a File, place: &str) -> Result<(Fat<'a>, &'static str), BadInput> {
    let opened = |range: Option<(u64, u64)>| {
        let (start, end) = range?;
        let slice = StreamSlice::new(file, start, end).ok()?;
        FileSystem::new(slice, FsOptions::new().time_provider(&Now)).ok()
    };
    let bytes = (&*file).seek(SeekFrom::End(0)).map_err(|error| fault(place, &error))?;
    if let Some(fat) = opened(Some((0, bytes))) {
        return Ok((fat, "on it"));
    }
    let partitions = fat_partitions(file, bytes).map_err(|error| fault(place, &error))?;
    let mut found: Vec<_> =
        partitions.into_iter().filter_map(|range| opened(Some(range))).collect();
    // The one for settings, or else the first.
    let settings = found.iter().position(|it| it.volume_label() == SETTINGS_LABEL).unwrap_or(0);
    if found.is_empty() {
        return Err(BadInput::whole(
            place,
            "neither a FAT file system nor a card with one on a partition of its table",
            "give an image of `cargo xtask image`, or the card that it was written to",
        ));
    }
    Ok((found.swap_remove(settings), "on its settings partition"))
}

/// Where the FAT partitions begin and end, by the table in the first sector.
fn fat_partitions(mut file: &File, bytes: u64) -> io::Result<Vec<(u64, u64)>> {
    if bytes < SECTOR_BYTES as u64 {
        return Ok(Vec::new());
    }
    let mut sector = [0; SECTOR_BYTES];
    file.seek(SeekFrom::Start(0))?;
    file.read_exact(&mut sector)?;
    if !sector.ends_with(&[0x55, 0xaa]) {
        return Ok(Vec::new());
    }
    let number = |entry: &[u8], at: usize| {
        let bytes = [entry[at], entry[at + 1], entry[at + 2], entry[at + 3]];
        u64::from(u32::from_le_bytes(bytes)) * SECTOR_BYTES as u64
    };
    let entries = sector[TABLE_START..].chunks_exact(ENTRY_BYTES);
    let found = entries.filter(|entry| FAT_TYPES.contains(&entry[4])).map(|entry| {
        let start = number(entry, 8);
        (start, (start + number(entry, 12)).min(bytes))
    });
    Ok(found.filter(|(start, end)| start < end).collect())
}

/// The bytes of a file that is there, if it is; one more than `bytes_max` at most.
fn read(fat: &Fat<'_>, name: &str, bytes_max: u64) -> io::Result<Option<Vec<u8>>> {
    let mut bytes = Vec::new();
    match fat.root_dir().open_file(name) {
        Ok(file) => file.take(bytes_max + 1).read_to_end(&mut bytes)?,
        Err(error) if error.kind() == ErrorKind::NotFound => return Ok(None),
        Err(error) => return Err(error),
    };
    Ok(Some(bytes))
}

fn replace(fat: &Fat<'_>, name: &str, new_name: &str, bytes: &[u8]) -> io::Result<()> {
    let root = fat.root_dir();
    let mut file = root.create_file(name)?;
    file.write_all(bytes)?;
    file.truncate()?;
    file.flush()?;
    // What a power cut has left there is older. It would come back if this one were damaged.
    match root.remove(new_name) {
        Err(error) if error.kind() != ErrorKind::NotFound => Err(error),
        _ => Ok(()),
    }
}

fn fault(place: &str, error: &io::Error) -> BadInput {
    match error.kind() {
        // The crate says so in words only.
        ErrorKind::Other if error.to_string().starts_with("No space left") => {
            BadInput::whole(place, "its file system is full", "remove what does not belong there")
        }
        // Not the system's, but of what is read: the file system contradicts itself.
        ErrorKind::Other | ErrorKind::InvalidData | ErrorKind::UnexpectedEof => {
            let found = format!("its file system is damaged ({error})");
            BadInput::whole(place, found, "write the image to the card again")
        }
        _ => BadInput::io(place, error),
    }
}

#[cfg(test)]
mod tests {
    use std::io::Cursor;
    use std::path::PathBuf;
    use std::sync::LazyLock;

    use fatfs::{FatType, FormatVolumeOptions, format_volume};

    use super::*;
    use plumbline_render::simulate::{Simulation, SimulationSettings};

    const MIB: usize = 1 << 20;

    static SCENE: LazyLock<Config> =
        LazyLock::new(|| Simulation::new(&SimulationSettings::default()).unwrap().config());

    fn config(device: &str) -> Config {
        let mut config = SCENE.clone();
        config.device = device.try_into().unwrap();
        config
    }

    fn blob(config: &Config) -> Vec<u8> {
        config.encode(&mut [0; BLOB_BYTES_MAX]).unwrap().to_vec()
    }

    /// A FAT file system of these bytes after `before` others, in a file.
    fn image(path: &Path, before: &[u8], mib: usize, fat_type: FatType) -> PathBuf {
        let mut disk = Cursor::new(vec![0; mib * MIB]);
        format_volume(&mut disk, FormatVolumeOptions::new().fat_type(fat_type)).unwrap();
        std::fs::write(path, [before, &disk.into_inner()].concat()).unwrap();
        path.to_owned()
    }

    /// A partition table whose second entry is a FAT32 partition of `mib` after it.
    fn table(mib: usize) -> Vec<u8> {
        let mut disk = vec![0; MIB];
        disk[TABLE_START + 4] = 0x83;
        let entry = &mut disk[TABLE_START + ENTRY_BYTES..][..ENTRY_BYTES];
        entry[4] = 0x0c;
        entry[8..12].copy_from_slice(&((MIB / SECTOR_BYTES) as u32).to_le_bytes());
        entry[12..].copy_from_slice(&((mib * MIB / SECTOR_BYTES) as u32).to_le_bytes());
        disk[SECTOR_BYTES - 2..SECTOR_BYTES].copy_from_slice(&[0x55, 0xaa]);
        disk
    }

    fn on(card: &Path) -> Vec<u8> {
        let file = open(card).unwrap();
        let (fat, _) = file_system(&file, "").unwrap();
        read(&fat, FILE_NAME, BLOB_BYTES_MAX as u64).unwrap().unwrap()
    }

    #[test]
    fn the_configuration_of_a_card_is_replaced_and_the_rest_is_left() {
        let folder = tempfile::tempdir().unwrap();
        let plain = image(&folder.path().join("plain"), &[], 1, FatType::Fat12);
        let card = image(&folder.path().join("card"), &table(64), 64, FatType::Fat32);
        for card in [&plain, &card] {
            {
                let file = open(card).unwrap();
                let (fat, _) = file_system(&file, "").unwrap();
                for (name, bytes) in [("vmlinuz", 70_000), (NEW_FILE_NAME, 900), ("notes", 5)] {
                    let mut file = fat.root_dir().create_file(name).unwrap();
                    file.write_all(&vec![7; bytes]).unwrap();
                }
            }
            let before = std::fs::read(card).unwrap();
            let mut shorter = config("simulation");
            shorter.targets.pop();
            for config in [config("simulation"), shorter] {
                write(card, &config, &blob(&config), None, false).unwrap();
                assert_eq!(on(card), blob(&config));
            }
            let after = std::fs::read(card).unwrap();
            assert_eq!(before.len(), after.len());
            let file = open(card).unwrap();
            let (fat, _) = file_system(&file, "").unwrap();
            let names: Vec<_> =
                fat.root_dir().iter().map(|entry| entry.unwrap().file_name()).collect();
            assert_eq!(names, ["vmlinuz", "notes", FILE_NAME]);
            let mut kernel = Vec::new();
            fat.root_dir().open_file("vmlinuz").unwrap().read_to_end(&mut kernel).unwrap();
            assert_eq!(kernel, vec![7; 70_000]);
        }
    }

    #[test]
    fn of_several_file_systems_the_one_for_settings_is_taken() {
        let folder = tempfile::tempdir().unwrap();
        let card = folder.path().join("card");
        for (labels, taken) in [
            ([*b"PL-CHOOSER ", *b"PLUMBLINE  "], 1),
            ([*b"PLUMBLINE  ", *b"PL-SLOT    "], 0),
            ([*b"ONE        ", *b"OTHER      "], 0),
        ] {
            let mut disk = vec![0; MIB];
            for (index, label) in labels.into_iter().enumerate() {
                let mut partition = Cursor::new(vec![0; MIB]);
                let options = FormatVolumeOptions::new().fat_type(FatType::Fat12);
                format_volume(&mut partition, options.volume_label(label)).unwrap();
                disk.extend(partition.into_inner());
                let entry = &mut disk[TABLE_START + index * ENTRY_BYTES..][..ENTRY_BYTES];
                entry[4] = 0x0c;
                let sectors = (MIB / SECTOR_BYTES) as u32;
                entry[8..12].copy_from_slice(&((index as u32 + 1) * sectors).to_le_bytes());
                entry[12..].copy_from_slice(&sectors.to_le_bytes());
            }
            disk[SECTOR_BYTES - 2..SECTOR_BYTES].copy_from_slice(&[0x55, 0xaa]);
            std::fs::write(&card, disk).unwrap();
            let config = config("ward 3");
            write(&card, &config, &blob(&config), None, false).unwrap();
            let file = open(&card).unwrap();
            for index in 0..labels.len() {
                let start = ((index + 1) * MIB) as u64;
                let slice = StreamSlice::new(&file, start, start + MIB as u64).unwrap();
                let fat = FileSystem::new(slice, FsOptions::new()).unwrap();
                assert_eq!(fat.root_dir().open_file(FILE_NAME).is_ok(), index == taken);
            }
        }
    }

    #[test]
    fn a_card_keeps_its_key_until_it_gets_another() {
        let folder = tempfile::tempdir().unwrap();
        let card = image(&folder.path().join("card"), &[], 1, FatType::Fat12);
        let config = config("ward 3");
        let [one, other] = [1, 2].map(|seed| Key::new([seed; 32]).unwrap());
        assert_eq!(super::key(&card, &config, false).unwrap(), Found::Nothing);
        for (written, found) in [
            (None, Found::Nothing),
            (Some(&one), Found::Key(one.clone())),
            (None, Found::Key(one.clone())),
            (Some(&other), Found::Key(other.clone())),
        ] {
            write(&card, &config, &blob(&config), written, false).unwrap();
            assert_eq!(super::key(&card, &config, false).unwrap(), found);
            assert_eq!(on(&card), blob(&config));
        }
        let put = |name: &str, text: &[u8]| {
            let file = open(&card).unwrap();
            let (fat, _) = file_system(&file, "").unwrap();
            let mut file = fat.root_dir().create_file(name).unwrap();
            file.write_all(text).unwrap();
            file.truncate().unwrap();
        };
        // What an interrupted replacement leaves: the box uses the file in place while it is whole.
        put(NEW_KEY_FILE_NAME, &keys::file(&one));
        assert_eq!(super::key(&card, &config, false).unwrap(), Found::Key(other.clone()));
        put(KEY_FILE_NAME, &keys::file(&other)[..40]);
        assert_eq!(super::key(&card, &config, false).unwrap(), Found::Key(one));
        put(NEW_KEY_FILE_NAME, b"");
        assert!(matches!(super::key(&card, &config, false).unwrap(), Found::Unusable(_)));
        write(&card, &config, &blob(&config), Some(&other), false).unwrap();
        let file = open(&card).unwrap();
        let (fat, _) = file_system(&file, "").unwrap();
        let names = fat.root_dir().iter().map(|entry| entry.unwrap().file_name());
        let mut names: Vec<_> = names.collect();
        names.sort();
        assert_eq!(names, [KEY_FILE_NAME, FILE_NAME]);
    }

    #[test]
    fn another_box_s_card_is_kept() {
        let folder = tempfile::tempdir().unwrap();
        let card = image(&folder.path().join("card"), &[], 1, FatType::Fat12);
        let [ours, theirs] = [config("ward 3"), config("ward 4")];
        write(&card, &theirs, &blob(&theirs), None, false).unwrap();
        let error = write(&card, &ours, &blob(&ours), None, false).unwrap_err().to_string();
        assert!(error.contains("ward 4") && error.contains("--force"), "{error}");
        assert_eq!(super::key(&card, &ours, false).unwrap_err().to_string(), error);
        assert_eq!(super::key(&card, &ours, true), Ok(Found::Nothing));
        assert_eq!(on(&card), blob(&theirs));
        write(&card, &ours, &blob(&ours), None, true).unwrap();
        assert_eq!(on(&card), blob(&ours));
    }

    #[test]
    fn what_is_no_card_is_refused_with_a_remedy() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("file");
        let config = config("ward 3");
        let refused = |bytes: Option<&[u8]>| {
            if let Some(bytes) = bytes {
                std::fs::write(&path, bytes).unwrap();
            }
            write(&path, &config, &blob(&config), None, false).unwrap_err().to_string()
        };
        assert!(refused(None).contains("check the path"));
        let table = table(8);
        for bytes in [&[][..], b"PLMB", &[0; 4096], &table] {
            let text = refused(Some(bytes));
            assert!(text.contains("neither a FAT") && text.contains("xtask image"), "{text}");
            assert_eq!(std::fs::read(&path).unwrap(), bytes);
        }
        let text =
            write(folder.path(), &config, &blob(&config), None, false).unwrap_err().to_string();
        assert!(text.contains("--out") && text.contains("config.plb"), "{text}");
    }

    #[test]
    fn a_full_card_says_so() {
        let folder = tempfile::tempdir().unwrap();
        let card = image(&folder.path().join("card"), &[], 1, FatType::Fat12);
        {
            let file = open(&card).unwrap();
            let (fat, _) = file_system(&file, "").unwrap();
            let mut filler = fat.root_dir().create_file("filler").unwrap();
            while filler.write_all(&[1; 512]).is_ok() {}
        }
        let config = config("ward 3");
        let error = write(&card, &config, &blob(&config), None, false).unwrap_err().to_string();
        assert!(error.contains("full"), "{error}");
    }
}
