//! Apple's frameworks for the linker.
//!
//! zig knows macOS's C library, and none of the frameworks above it. A program that uses one only has
//! to say which: macOS has it at the same place on every computer. So the linker gets a text stub for
//! each, as Apple's own tools make them, with the names that the crates of `plumb` ask for.

use std::fs;
use std::path::Path;

use anyhow::{Context, Result};

/// A framework, and the names that are used of it.
struct Framework {
    name: &'static str,
    symbols: &'static [&'static str],
}

const FRAMEWORKS: [Framework; 3] = [
    Framework {
        name: "CoreFoundation",
        symbols: &[
            "CFArrayCreate",
            "CFArrayGetCount",
            "CFArrayGetTypeID",
            "CFArrayGetValueAtIndex",
            "CFBooleanGetTypeID",
            "CFBooleanGetValue",
            "CFCopyDescription",
            "CFDataCreate",
            "CFDataGetBytePtr",
            "CFDataGetLength",
            "CFDataGetTypeID",
            "CFDictionaryAddValue",
            "CFDictionaryContainsKey",
            "CFDictionaryCreate",
            "CFDictionaryCreateMutable",
            "CFDictionaryGetCount",
            "CFDictionaryGetKeysAndValues",
            "CFDictionaryGetTypeID",
            "CFDictionaryGetValue",
            "CFDictionaryGetValueIfPresent",
            "CFDictionaryRemoveValue",
            "CFDictionarySetValue",
            "CFEqual",
            "CFGetRetainCount",
            "CFGetTypeID",
            "CFHash",
            "CFNumberCreate",
            "CFNumberGetTypeID",
            "CFNumberGetValue",
            "CFRelease",
            "CFRetain",
            "CFShow",
            "CFStringCreateWithBytes",
            "CFStringCreateWithBytesNoCopy",
            "CFStringCreateWithCString",
            "CFStringGetBytes",
            "CFStringGetCString",
            "CFStringGetCStringPtr",
            "CFStringGetLength",
            "CFStringGetTypeID",
            "kCFAllocatorDefault",
            "kCFAllocatorNull",
            "kCFBooleanFalse",
            "kCFBooleanTrue",
            "kCFTypeArrayCallBacks",
            "kCFTypeDictionaryKeyCallBacks",
            "kCFTypeDictionaryValueCallBacks",
        ],
    },
    Framework {
        name: "IOKit",
        symbols: &[
            "IOIteratorNext",
            "IOMasterPort",
            "IOObjectGetClass",
            "IOObjectRelease",
            "IORegistryEntryCreateCFProperties",
            "IORegistryEntryCreateCFProperty",
            "IORegistryEntryGetParentEntry",
            "IOServiceGetMatchingServices",
            "IOServiceMatching",
            "kIOMasterPortDefault",
        ],
    },
    // The certificates that the computer trusts.
    Framework {
        name: "Security",
        symbols: &[
            "SecCertificateCopyData",
            "SecCopyErrorMessageString",
            "SecTrustSettingsCopyCertificates",
            "SecTrustSettingsCopyTrustSettings",
        ],
    },
];

/// Flags with which the linker finds the frameworks, whose stubs are written to `directory`, and leaves
/// out what a debugger wants: whatever did it afterwards would spoil the signature of what is linked,
/// and Debian's compiler has no tool for it.
pub fn flags(directory: &Path) -> Result<String> {
    for framework in &FRAMEWORKS {
        let folder = directory.join(format!("{}.framework", framework.name));
        fs::create_dir_all(&folder).with_context(|| folder.display().to_string())?;
        let path = folder.join(format!("{}.tbd", framework.name));
        fs::write(&path, framework.stub()).with_context(|| path.display().to_string())?;
    }
    Ok(format!(" -Clink-arg=-F{} -Clink-arg=-s", directory.display()))
}

impl Framework {
    /// The stub, in the fourth version of the format.
    fn stub(&self) -> String {
        let name = self.name;
        let symbols: Vec<String> = self.symbols.iter().map(|it| format!("_{it}")).collect();
        format!(
            "--- !tapi-tbd\n\
             tbd-version: 4\n\
             targets: [ x86_64-macos, arm64-macos ]\n\
             install-name: '/System/Library/Frameworks/{name}.framework/Versions/A/{name}'\n\
             exports:\n  \
               - targets: [ x86_64-macos, arm64-macos ]\n    \
                 symbols: [ {} ]\n\
             ...\n",
            symbols.join(", ")
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stub_names_where_macos_has_the_framework() {
        let folder = tempfile::tempdir().unwrap();
        let flags = flags(folder.path()).unwrap();
        assert_eq!(flags, format!(" -Clink-arg=-F{} -Clink-arg=-s", folder.path().display()));
        let stub = fs::read_to_string(folder.path().join("IOKit.framework/IOKit.tbd")).unwrap();
        assert!(stub.contains("\ninstall-name: '/System/Library/Frameworks/IOKit.framework/"));
        assert!(stub.contains("_IOServiceMatching, "), "{stub}");
    }
}
