//! Short protocols.

/// A protocol of two short conditions whose t = 0 is the first frame.
pub fn protocol(duration_s: u32) -> String {
    let condition = |name: &str| {
        format!(
            "[[condition]]\nname = \"{name}\"\nlabel = \"{name}\"\ninstruction = \"Stand still.\"\n\
             duration_s = {duration_s}\n"
        )
    };
    // A box that shares a busy computer falls behind its camera's pace.
    let compared_s = duration_s / 2;
    format!(
        "name = \"Short\"\norder = {{ by = \"fixed\" }}\ntones = {{ start = true, end = true }}\n\
         countdown_s = 1\nzero = \"start\"\nbins_s = [[0, {compared_s}]]\n{}{}",
        condition("eyes-open"),
        condition("eyes-closed")
    )
}

/// A protocol of one condition whose t = 0 is a mark.
pub fn marked(duration_s: u32) -> String {
    format!(
        "name = \"Marked\"\norder = {{ by = \"fixed\" }}\nzero = \"mark\"\nmarks = [\"stands\"]\n\
         bins_s = [[0, {duration_s}]]\n[[condition]]\nname = \"stance\"\nlabel = \"Stance\"\n\
         instruction = \"Stand up.\"\nbaseline_s = 1\nduration_s = {duration_s}\n"
    )
}
