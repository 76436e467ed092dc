//! What a step says while it goes on, for whoever waits for it.

/// Something that a step says.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Told {
    /// This is being waited for, until [`Told::Done`].
    Waiting(String),
    /// What was waited for has come, or will not come.
    Done,
    /// Something that was found or done.
    Note(String),
    /// Something that may not be as the user wants it.
    Warning(String),
}

/// Is told what a step says, when it says it.
pub type Tell<'a> = dyn FnMut(Told) + 'a;

/// Does some work, and says meanwhile what is being waited for.
pub(crate) fn waiting<T>(
    tell: &mut Tell<'_>,
    what: impl Into<String>,
    work: impl FnOnce() -> T,
) -> T {
    tell(Told::Waiting(what.into()));
    let result = work();
    tell(Told::Done);
    result
}
