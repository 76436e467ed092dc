//! Which axis of a reference is which axis of the body.

use crate::series::Axis;

/// For each body axis, the reference's axis (0 to 2 for X to Z) and its sign, if the reference has
/// it. The mapping only permutes and mirrors axes; it never scales.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Axes([Option<(usize, bool)>; 3]);

/// The names of a reference's axes.
const NAMES: [&str; 3] = ["X", "Y", "Z"];

impl Axes {
    /// From `ap=X,ml=-Y,si=Z`; an axis that is left out is not compared.
    ///
    /// # Errors
    /// The message says what to give instead.
    pub fn parse(text: &str) -> Result<Self, String> {
        const REMEDY: &str =
            "give them as ap=X,ml=-Y,si=Z, each axis once, with a minus if it points the other way";
        let mut axes = [None; 3];
        for part in text.split(',') {
            let (body, name) = part.split_once('=').ok_or_else(|| REMEDY.to_owned())?;
            let (body, name) = (body.trim(), name.trim());
            let axis = Axis::ALL.into_iter().find(|it| it.word().eq_ignore_ascii_case(body));
            let axis = axis.ok_or_else(|| format!("{body:?} is not a body axis: {REMEDY}"))?;
            let (is_negative, letter) = match name.strip_prefix('-') {
                Some(letter) => (true, letter),
                None => (false, name.strip_prefix('+').unwrap_or(name)),
            };
            let place = NAMES.iter().position(|it| it.eq_ignore_ascii_case(letter));
            let place = place.ok_or_else(|| format!("{name:?} is not X, Y or Z: {REMEDY}"))?;
            let is_taken = axes.iter().flatten().any(|(taken, _)| *taken == place);
            if is_taken || axes[axis as usize].replace((place, is_negative)).is_some() {
                return Err(format!("{part:?} names an axis again: {REMEDY}"));
            }
        }
        Ok(Self(axes))
    }

    /// The body coordinates of points given by their columns X, Y and Z; empty for an axis that is
    /// left out.
    #[must_use]
    pub fn apply(&self, columns: [&[f64]; 3]) -> [Vec<f64>; 3] {
        self.0.map(|axis| match axis {
            Some((place, true)) => columns[place].iter().map(|it| -it).collect(),
            Some((place, false)) => columns[place].to_vec(),
            None => Vec::new(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn axes_are_turned_and_mirrored() {
        let axes = Axes::parse("ap=Z, ml=-x,si=+Y").unwrap();
        let found = axes.apply([&[1.0, 2.0], &[3.0, 4.0], &[5.0, 6.0]]);
        assert_eq!(found, [vec![5.0, 6.0], vec![-1.0, -2.0], vec![3.0, 4.0]]);
        let two = Axes::parse("ap=X,si=Z").unwrap().apply([&[1.0], &[2.0], &[3.0]]);
        assert_eq!(two, [vec![1.0], vec![], vec![3.0]]);
    }

    #[test]
    fn what_is_no_rotation_is_refused() {
        for text in ["", "ap", "ap=W", "up=X", "ap=X,ml=-X", "ap=X,ap=Y", "ap=--X"] {
            assert!(Axes::parse(text).unwrap_err().contains("ap=X,ml=-Y,si=Z"), "{text}");
        }
    }
}
