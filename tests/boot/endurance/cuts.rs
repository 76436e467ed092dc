//! The power is cut while the box writes to its card: one test for each kind of thing that it writes.
//! What a computer of the lab writes while it records is in `tests/link/endurance.rs`.

use plumbline_test_support::{evidence, repetitions};

use crate::provisioning;

/// A card that takes so long to write that many of the cuts fall in the middle of it.
const SLOW_CARD: &str = "throttling.iops-write=20";

#[test]
#[ignore = "takes an hour: cargo xtask test endurance"]
fn while_configurations_are_stored() {
    let cuts = repetitions(100);
    let cut = provisioning::power_cuts(cuts, SLOW_CARD);
    assert!(cuts < 20 || cut.in_the_middle > 0, "no cut fell in the middle of writing: {cut:?}");
    evidence(
        "power cuts at random moments while configurations are stored (booted box, its FAT disk with 20 \
         writes a second, the emulator killed)",
        &format!("{cuts} cuts in {} configurations stored", cut.stored),
        &format!(
            "{cuts} of {cuts} left the old or the new configuration whole, and the key; {} fell in the \
             middle of writing; the box starts",
            cut.in_the_middle
        ),
    );
}
