//! The official library, liblsl, by its C interface: the only unsafe code of this crate.
//!
//! # Contracts
//!
//! The interface is that of `lsl_c.h` of liblsl 1.13 to 1.18, whose functions keep their types
//! throughout (version 2 of its binary interface). Here every function has exactly the type that it
//! has there, and these promises of the library are relied on:
//!
//! - no exception and no panic leaves it; a failure is a null pointer or an error code;
//! - it copies every text and every value that it is given before it returns;
//! - an outlet or an inlet does not need the description from which it was made;
//! - a handle may be used by one thread at a time, and by another than the one that made it. Here it
//!   stays in the thread that made it, because the types are not `Send`;
//! - the texts of a sample that it hands over are the caller's, to be returned by
//!   `lsl_destroy_string`; all other texts are its own.
//!
//! The library has threads of its own and is never unloaded.
#![allow(unsafe_code)]

use std::ffi::{CStr, CString, OsString, c_char, c_void};
use std::path::Path;
use std::ptr::{NonNull, null_mut};

use libloading::Library;
use plumbline_files::BadInput;

/// The environment variable with the library's path, where the system does not find it.
pub const LIBRARY: &str = "PLUMBLINE_LIBLSL";

/// The library's names on Linux, Windows and macOS.
const NAMES: [&str; 5] = ["liblsl.so.2", "liblsl.so", "lsl.dll", "liblsl.dylib", "liblsl.2.dylib"];

/// Older ones lack functions, or were never tested.
const VERSION_MIN: i32 = 113;

const REMEDY: &str = "install liblsl (https://github.com/sccn/liblsl/releases; on Debian and Ubuntu its \
                      .deb package; or `pip install pylsl`, which contains it), or name its file in \
                      the environment variable PLUMBLINE_LIBLSL";

/// Where the library looks for its settings, besides `LSLAPICFG`.
const SETTINGS: [&str; 3] = ["lsl_api.cfg", "lsl_api/lsl_api.cfg", "/etc/lsl_api/lsl_api.cfg"];

/// Used where the user has no settings: its messages would disturb the terminal.
const SILENT: &CStr = c"[log]\nlevel = -3\n";

/// `cft_double64` and `cft_string`.
const DOUBLE: i32 = 2;
const STRING: i32 = 3;

/// The error code of a stream whose source is lost.
const LOST: i32 = -2;

type Handle = *mut c_void;

/// The library, loaded once and for as long as the program runs.
#[derive(Clone, Copy)]
pub struct Lsl(&'static Functions);

impl std::fmt::Debug for Lsl {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "liblsl {}", self.version())
    }
}

struct Functions {
    library_version: unsafe extern "C" fn() -> i32,
    local_clock: unsafe extern "C" fn() -> f64,
    create_streaminfo:
        unsafe extern "C" fn(*const c_char, *const c_char, i32, f64, i32, *const c_char) -> Handle,
    destroy_streaminfo: unsafe extern "C" fn(Handle),
    get_desc: unsafe extern "C" fn(Handle) -> Handle,
    append_child: unsafe extern "C" fn(Handle, *const c_char) -> Handle,
    append_child_value: unsafe extern "C" fn(Handle, *const c_char, *const c_char) -> Handle,
    create_outlet: unsafe extern "C" fn(Handle, i32, i32) -> Handle,
    destroy_outlet: unsafe extern "C" fn(Handle),
    push_sample_dtp: unsafe extern "C" fn(Handle, *const f64, f64, i32) -> i32,
    push_sample_strtp: unsafe extern "C" fn(Handle, *const *const c_char, f64, i32) -> i32,
    have_consumers: unsafe extern "C" fn(Handle) -> i32,
    resolve_byprop:
        unsafe extern "C" fn(*mut Handle, u32, *const c_char, *const c_char, i32, f64) -> i32,
    get_type: unsafe extern "C" fn(Handle) -> *const c_char,
    get_channel_count: unsafe extern "C" fn(Handle) -> i32,
    create_inlet: unsafe extern "C" fn(Handle, i32, i32, i32) -> Handle,
    destroy_inlet: unsafe extern "C" fn(Handle),
    open_stream: unsafe extern "C" fn(Handle, f64, *mut i32),
    time_correction: unsafe extern "C" fn(Handle, f64, *mut i32) -> f64,
    pull_sample_str: unsafe extern "C" fn(Handle, *mut *mut c_char, i32, f64, *mut i32) -> f64,
    destroy_string: unsafe extern "C" fn(*mut c_char),
}

/// A function of the library.
///
/// # Safety
/// `F` is the type of the function with this name in `lsl_c.h`.
unsafe fn function<F: Copy>(library: &Library, name: &str) -> Result<F, libloading::Error> {
    // SAFETY: the caller knows the type; the library is never unloaded, so that the function stays.
    unsafe { library.get::<F>(name).map(|symbol| *symbol) }
}

impl Functions {
    fn of(library: &Library) -> Result<Self, libloading::Error> {
        // SAFETY: the fields have the types of the functions in `lsl_c.h`, from which they were
        // written down.
        unsafe {
            Ok(Self {
                library_version: function(library, "lsl_library_version")?,
                local_clock: function(library, "lsl_local_clock")?,
                create_streaminfo: function(library, "lsl_create_streaminfo")?,
                destroy_streaminfo: function(library, "lsl_destroy_streaminfo")?,
                get_desc: function(library, "lsl_get_desc")?,
                append_child: function(library, "lsl_append_child")?,
                append_child_value: function(library, "lsl_append_child_value")?,
                create_outlet: function(library, "lsl_create_outlet")?,
                destroy_outlet: function(library, "lsl_destroy_outlet")?,
                push_sample_dtp: function(library, "lsl_push_sample_dtp")?,
                push_sample_strtp: function(library, "lsl_push_sample_strtp")?,
                have_consumers: function(library, "lsl_have_consumers")?,
                resolve_byprop: function(library, "lsl_resolve_byprop")?,
                get_type: function(library, "lsl_get_type")?,
                get_channel_count: function(library, "lsl_get_channel_count")?,
                create_inlet: function(library, "lsl_create_inlet")?,
                destroy_inlet: function(library, "lsl_destroy_inlet")?,
                open_stream: function(library, "lsl_open_stream")?,
                time_correction: function(library, "lsl_time_correction")?,
                pull_sample_str: function(library, "lsl_pull_sample_str")?,
                destroy_string: function(library, "lsl_destroy_string")?,
            })
        }
    }
}

impl Lsl {
    /// Loads the library: the one that [`LIBRARY`] names, or else the system's.
    ///
    /// # Errors
    /// When there is none, or it is too old; the message says what to install.
    pub fn load() -> Result<Self, BadInput> {
        let named = std::env::var_os(LIBRARY).filter(|it| !it.is_empty());
        let bad = |found: String| {
            let place = named.as_deref().unwrap_or("the Lab Streaming Layer".as_ref());
            BadInput::whole(Path::new(place).display(), found, REMEDY)
        };
        let names = named
            .clone()
            .map_or_else(|| NAMES.iter().map(OsString::from).collect(), |named| vec![named]);
        let mut why = String::new();
        let library = names.iter().find_map(|name| {
            // SAFETY: what runs when it is loaded is liblsl's own initialisation, which has no
            // conditions; that a file of this name is liblsl is what the user has installed or said.
            let loaded = unsafe { Library::new(name) };
            loaded.map_err(|error| why = error.to_string()).ok()
        });
        let Some(library) = library else {
            return Err(bad(match named {
                Some(_) => format!("cannot be loaded ({why})"),
                None => "its library, liblsl, is not on this computer".to_owned(),
            }));
        };
        // It has threads: it stays.
        let library: &'static Library = Box::leak(Box::new(library));
        let functions = Functions::of(library);
        let functions = functions.map_err(|error| bad(format!("is not liblsl ({error})")))?;
        let lsl = Self(Box::leak(Box::new(functions)));
        lsl.silence(library);
        let version = lsl.version();
        if version < VERSION_MIN {
            return Err(bad(format!("is version {}.{}, too old", version / 100, version % 100)));
        }
        Ok(lsl)
    }

    /// Without settings of the user, the library writes nothing to the terminal. From 1.17.7 on; an
    /// older one says which addresses it uses.
    fn silence(self, library: &Library) {
        let home = std::env::var_os("HOME").unwrap_or_default();
        let is_set = std::env::var_os("LSLAPICFG").is_some()
            || SETTINGS.iter().any(|it| Path::new(it).exists())
            || Path::new(&home).join(SETTINGS[1]).exists();
        if is_set {
            return;
        }
        type Set = unsafe extern "C" fn(*const c_char);
        // SAFETY: the type is that in `lsl_c.h`.
        if let Ok(set) = unsafe { function::<Set>(library, "lsl_set_config_content") } {
            // SAFETY: the text ends with 0 and is copied; nothing else of the library was called
            // before, as the function demands.
            unsafe { set(SILENT.as_ptr()) };
        }
    }

    /// Hundreds are the major version.
    #[must_use]
    pub fn version(self) -> i32 {
        // SAFETY: has no conditions.
        unsafe { (self.0.library_version)() }
    }

    /// The library's clock, in seconds.
    #[must_use]
    pub fn local_clock(self) -> f64 {
        // SAFETY: has no conditions.
        unsafe { (self.0.local_clock)() }
    }

    /// The stream of markers with this name, if one is found within this time.
    pub(super) fn resolve_markers(self, name: &str, within_s: f64) -> Option<Found> {
        let mut found: [Handle; 8] = [null_mut(); 8];
        let name = text(name);
        // SAFETY: the texts end with 0; the buffer has room for as many handles as is said, and the
        // library writes no more.
        let count = unsafe {
            let resolve = self.0.resolve_byprop;
            resolve(
                found.as_mut_ptr(),
                found.len() as u32,
                c"name".as_ptr(),
                name.as_ptr(),
                1,
                within_s,
            )
        };
        // Those that are not wanted are destroyed, too.
        let count = usize::try_from(count).unwrap_or(0).min(found.len());
        let all = found[..count]
            .iter()
            .filter_map(|it| Some(Found { lsl: self, info: NonNull::new(*it)? }));
        let all: Vec<Found> = all.collect();
        all.into_iter().find(|it| it.content_type() == "Markers")
    }
}

/// A text for the library, which ends at a 0.
fn text(text: &str) -> CString {
    let bytes: Vec<u8> = text.bytes().filter(|byte| *byte != 0).collect();
    CString::new(bytes).unwrap_or_default()
}

/// What a stream is, for those who look for it and for those who record it.
pub(super) struct StreamInfo<'a> {
    /// Its name.
    pub name: &'a str,
    /// Its content type.
    pub content_type: &'a str,
    /// By which it is known again after a restart.
    pub source_id: &'a str,
    /// Its channels, if they are numbers; of text there is one.
    pub channels: Option<usize>,
    /// What is inside its `desc`.
    pub desc: &'a [super::description::Element],
}

/// A stream that this program offers. Its samples have times of their own (an irregular rate).
pub(super) struct Outlet {
    lsl: Lsl,
    handle: NonNull<c_void>,
    channels: Option<usize>,
}

impl Outlet {
    /// Offers a stream; `None` where the library has no memory or no port for it. It keeps
    /// `hundreds` hundred samples for a consumer that is slow, and drops the oldest beyond that.
    pub(super) fn new(lsl: Lsl, info: &StreamInfo<'_>, hundreds: i32) -> Option<Self> {
        let [name, content_type, source_id] =
            [info.name, info.content_type, info.source_id].map(text);
        let (count, format) = match info.channels {
            Some(channels) => (i32::try_from(channels).ok()?, DOUBLE),
            None => (1, STRING),
        };
        // SAFETY: the texts end with 0 and are copied. Both handles are checked before they are
        // used; the description is destroyed once, after its last use, and its `desc` is not used
        // after that.
        unsafe {
            let f = lsl.0;
            let create = f.create_streaminfo;
            let (name, content_type) = (name.as_ptr(), content_type.as_ptr());
            let described =
                NonNull::new(create(name, content_type, count, 0.0, format, source_id.as_ptr()))?;
            lsl.describe((f.get_desc)(described.as_ptr()), info.desc);
            let outlet = (f.create_outlet)(described.as_ptr(), 0, hundreds);
            (f.destroy_streaminfo)(described.as_ptr());
            Some(Self { lsl, handle: NonNull::new(outlet)?, channels: info.channels })
        }
    }

    /// Offers a sample of numbers, captured at this time of the library's clock.
    pub(super) fn push(&self, values: &[f64], lsl_s: f64) {
        assert_eq!(Some(values.len()), self.channels, "one value for each channel");
        // SAFETY: the handle is that of an outlet of as many numbers as there are; the library
        // copies them.
        unsafe { (self.lsl.0.push_sample_dtp)(self.handle.as_ptr(), values.as_ptr(), lsl_s, 1) };
    }

    /// Offers a sample of one text.
    pub(super) fn push_text(&self, label: &str, lsl_s: f64) {
        assert_eq!(self.channels, None, "a stream of text");
        let label = text(label);
        let values = [label.as_ptr()];
        // SAFETY: the handle is that of an outlet of one text; the library copies it.
        unsafe { (self.lsl.0.push_sample_strtp)(self.handle.as_ptr(), values.as_ptr(), lsl_s, 1) };
    }

    /// Whether somebody takes the stream.
    pub(super) fn has_consumers(&self) -> bool {
        // SAFETY: the handle is that of an outlet.
        unsafe { (self.lsl.0.have_consumers)(self.handle.as_ptr()) != 0 }
    }
}

impl Drop for Outlet {
    fn drop(&mut self) {
        // SAFETY: the handle is that of an outlet, and is not used after this.
        unsafe { (self.lsl.0.destroy_outlet)(self.handle.as_ptr()) };
    }
}

impl Lsl {
    /// Adds elements to one of a description's.
    ///
    /// # Safety
    /// `parent` is an element of a description that has not been destroyed.
    unsafe fn describe(self, parent: Handle, elements: &[super::description::Element]) {
        use super::description::Content;
        for element in elements {
            let name = text(element.name);
            match &element.content {
                Content::Text(value) => {
                    let value = text(value);
                    // SAFETY: the parent is the caller's; the texts end with 0 and are copied.
                    unsafe { (self.0.append_child_value)(parent, name.as_ptr(), value.as_ptr()) };
                }
                Content::Elements(inner) => {
                    // SAFETY: as above; the child belongs to the same description.
                    unsafe { self.describe((self.0.append_child)(parent, name.as_ptr()), inner) };
                }
            }
        }
    }
}

/// A stream of another program that was found.
pub(super) struct Found {
    lsl: Lsl,
    info: NonNull<c_void>,
}

impl Found {
    fn content_type(&self) -> String {
        // SAFETY: the handle is that of a description; the text is the library's, ends with 0, and
        // is copied before the description is destroyed.
        unsafe { copied((self.lsl.0.get_type)(self.info.as_ptr())) }
    }
}

impl Drop for Found {
    fn drop(&mut self) {
        // SAFETY: the handle is that of a description, and is not used after this.
        unsafe { (self.lsl.0.destroy_streaminfo)(self.info.as_ptr()) };
    }
}

/// # Safety
/// The text ends with 0 and lives until this returns; or it is null.
unsafe fn copied(text: *const c_char) -> String {
    if text.is_null() {
        return String::new();
    }
    // SAFETY: the caller's.
    unsafe { CStr::from_ptr(text) }.to_string_lossy().into_owned()
}

/// A stream of another program, whose samples are taken as text.
pub(super) struct Inlet {
    lsl: Lsl,
    handle: NonNull<c_void>,
    channels: usize,
}

/// The stream is gone.
#[derive(Debug)]
pub(super) struct Lost;

impl Inlet {
    /// Takes the stream, from now on.
    pub(super) fn open(found: &Found, within_s: f64) -> Result<Self, Lost> {
        let lsl = found.lsl;
        // SAFETY: the handle is that of a description; the inlet copies it.
        let (handle, channels) = unsafe {
            let channels = (lsl.0.get_channel_count)(found.info.as_ptr());
            ((lsl.0.create_inlet)(found.info.as_ptr(), 360, 0, 1), channels)
        };
        let handle = NonNull::new(handle).ok_or(Lost)?;
        let channels = usize::try_from(channels).ok().filter(|it| (1..=64).contains(it));
        // From here on the inlet is destroyed, whatever happens.
        let inlet = Self { lsl, handle, channels: channels.unwrap_or(0) };
        channels.ok_or(Lost)?;
        let mut error = 0;
        // SAFETY: the handle is that of an inlet; the error has a place.
        unsafe { (lsl.0.open_stream)(inlet.handle.as_ptr(), within_s, &raw mut error) };
        if error == 0 { Ok(inlet) } else { Err(Lost) }
    }

    /// What must be added to the stream's times to have those of this computer.
    pub(super) fn time_correction(&self, within_s: f64) -> Result<f64, Lost> {
        let mut error = 0;
        // SAFETY: as above.
        let correction_s =
            unsafe { (self.lsl.0.time_correction)(self.handle.as_ptr(), within_s, &raw mut error) };
        if error == 0 { Ok(correction_s) } else { Err(Lost) }
    }

    /// The next sample and its time, if one comes within this time; the texts of several channels
    /// are joined by spaces.
    pub(super) fn pull(&self, within_s: f64) -> Result<Option<(String, f64)>, Lost> {
        let mut texts = vec![null_mut::<c_char>(); self.channels];
        let (mut error, count) = (0, self.channels as i32);
        // SAFETY: the handle is that of an inlet; there is room for a text of each channel, and the
        // library writes no more. The texts that it hands over are this program's.
        let time_s = unsafe {
            let pull = self.lsl.0.pull_sample_str;
            pull(self.handle.as_ptr(), texts.as_mut_ptr(), count, within_s, &raw mut error)
        };
        let words = texts.iter().map(|it| {
            // SAFETY: null, or a text that ends with 0, which is copied and returned once.
            unsafe {
                let word = copied(*it);
                if !it.is_null() {
                    (self.lsl.0.destroy_string)(*it);
                }
                word
            }
        });
        let words: Vec<String> = words.collect();
        match error {
            LOST => Err(Lost),
            _ if time_s == 0.0 => Ok(None),
            _ => Ok(Some((words.join(" "), time_s))),
        }
    }
}

impl Drop for Inlet {
    fn drop(&mut self) {
        // SAFETY: the handle is that of an inlet, and is not used after this.
        unsafe { (self.lsl.0.destroy_inlet)(self.handle.as_ptr()) };
    }
}
