//! Chooses the linker scripts of the target board.

use std::env;

fn main() {
    println!("cargo:rerun-if-changed=build.rs");
    println!("cargo:rerun-if-changed=link");
    let cargo = |name: &str| env::var(format!("CARGO_{name}")).expect("cargo sets it");
    if cargo("CFG_TARGET_OS") != "none" {
        return;
    }
    println!("cargo:rustc-link-search={}/link", cargo("MANIFEST_DIR"));
    // The start-up crates' scripts lay out the program; those of this package say where memory is.
    let arguments: &[&str] = match cargo("CFG_TARGET_ARCH").as_str() {
        "aarch64" => &["-Timage.ld", "-Tvirt.ld"],
        // The file's headers must not be in memory: the vectors are at its very start.
        _ => &["--nmagic", "-Tlink.x"],
    };
    for argument in arguments {
        println!("cargo:rustc-link-arg={argument}");
    }
}
