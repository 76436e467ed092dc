//! Where labels of vertical lines go: in lanes above a plot, so that no label covers another, and
//! no line crosses one.

use std::ops::Range;

/// Height of a lane.
pub(crate) const LANE_PX: i32 = 16;

/// More would take more room than the plot; what finds no place stays without a label.
const LANES_MAX: i32 = 4;

/// From a line to its label, and between labels.
const APART_PX: i32 = 5;

/// An average letter of 13 px, which a sans serif font seldom exceeds.
const LETTER_WIDTH_PX: usize = 8;

/// The width of a text.
pub(crate) fn width_px(text: &str) -> i32 {
    (LETTER_WIDTH_PX * text.chars().count()) as i32
}

/// Where a label is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Place {
    /// From above; the line begins here as well, and goes down to the plot and through it.
    pub lane: i32,
    /// Its left end.
    pub left_px: i32,
}

/// A line and its label as they were placed.
struct Placed {
    x_px: i32,
    lane: i32,
    label_px: Range<i32>,
}

impl Placed {
    /// Neither label covers the other, and neither line crosses the other's label.
    fn leaves(&self, other: &Self) -> bool {
        let overlap = self.label_px.start < other.label_px.end + APART_PX
            && other.label_px.start < self.label_px.end + APART_PX;
        let crosses = |line: &Self, label: &Self| {
            line.lane <= label.lane && label.label_px.contains(&line.x_px)
        };
        let covers = self.lane == other.lane && overlap;
        !(covers || crosses(self, other) || crosses(other, self))
    }
}

/// Places for the labels of lines, given by their x and their text, within a span of x: to the
/// right of its line or else to the left, as high as possible.
pub(crate) fn place(marks: &[(i32, &str)], within_px: Range<i32>) -> Vec<Option<Place>> {
    let mut placed: Vec<Placed> = Vec::new();
    let mut find = |(x_px, text): &(i32, &str)| {
        let width = width_px(text);
        let lefts = [x_px + APART_PX, x_px - APART_PX - width];
        let candidates = (0..LANES_MAX).flat_map(|lane| lefts.map(|left| (lane, left)));
        let (lane, left_px) = candidates.into_iter().find(|&(lane, left)| {
            let one = Placed { x_px: *x_px, lane, label_px: left..left + width };
            within_px.start <= left
                && left + width <= within_px.end
                && placed.iter().all(|other| one.leaves(other))
        })?;
        placed.push(Placed { x_px: *x_px, lane, label_px: left_px..left_px + width });
        Some(Place { lane, left_px })
    };
    marks.iter().map(&mut find).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn labels_stand_beside_their_lines_and_below_what_is_in_their_way() {
        let at = |lane, left_px| Some(Place { lane, left_px });
        // "stands" takes 48 px.
        assert_eq!(place(&[(100, "stands")], 0..1000), [at(0, 105)]);
        assert_eq!(place(&[(980, "stands")], 0..1000), [at(0, 980 - 5 - 48)]);
        // Side by side; or within the first one's label, and then below it.
        assert_eq!(place(&[(100, "stands"), (160, "x")], 0..1000), [at(0, 105), at(0, 165)]);
        let close = [(100, "stands"), (120, "moves"), (130, "sits"), (135, "xx"), (140, "x")];
        let below = [at(0, 105), at(1, 125), at(2, 135), at(3, 140), None];
        assert_eq!(place(&close, 0..1000), below);
        // At one and the same time: the other side of the line.
        assert_eq!(place(&[(100, "a"), (100, "b")], 0..1000), [at(0, 105), at(0, 87)]);
        // Too long for the plot.
        assert_eq!(place(&[(50, "stands")], 0..100), [None]);
    }

    #[test]
    fn no_label_is_covered_or_crossed_however_many_there_are() {
        let marks: Vec<(i32, &str)> = (0..60).map(|at| (at * at * 7 % 1000, "label")).collect();
        let places = place(&marks, 0..1000);
        let placed: Vec<Placed> = marks
            .iter()
            .zip(&places)
            .filter_map(|((x_px, _), place)| {
                let Place { lane, left_px } = (*place)?;
                Some(Placed { x_px: *x_px, lane, label_px: left_px..left_px + 40 })
            })
            .collect();
        // Lanes of 1000 px that hold labels of 45 px could hold 88 at best.
        assert!(placed.len() > 15, "{}", placed.len());
        for (at, one) in placed.iter().enumerate() {
            assert!(placed[..at].iter().all(|other| one.leaves(other)));
            assert!((0..LANES_MAX).contains(&one.lane));
        }
    }
}
