//! A corner, and the list of the strongest corners.

use heapless::Vec;

use crate::limits::CORNERS_MAX;

/// Two corners nearer than this are one: the radius of Geiger's non-maxima suppression.
const SEPARATION_PX: f32 = 3.0;

/// A checkerboard corner, located to about a quarter of a pixel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Corner {
    /// Its position, x and y.
    pub position_px: [f32; 2],
    /// Its quality, above 0 and at most 0.5: the correlation of the gradient with the two edges (at
    /// most 1) times the likelihood along these edges (half the contrast, white level = 1).
    pub score: f32,
    /// Directions of the two edges through the corner, `[0, pi)`, from x towards
    /// y. The sector swept from edge 0 to edge 1 by INCREASING angle (mod pi) is
    /// DARK, so that neighbours on a checkerboard have the roles of their two
    /// edges exchanged.
    pub edges_rad: [f32; 2],
}

/// The strongest corners of a search, and how many did not fit.
#[derive(Debug)]
pub struct CornerList {
    corners: Vec<Corner, CORNERS_MAX>,
    dropped: u32,
}

impl Default for CornerList {
    fn default() -> Self {
        Self::new()
    }
}

impl CornerList {
    /// An empty list.
    #[must_use]
    pub const fn new() -> Self {
        Self { corners: Vec::new(), dropped: 0 }
    }

    /// Removes all corners, and resets the count of dropped ones.
    pub fn clear(&mut self) {
        self.corners.clear();
        self.dropped = 0;
    }

    /// The corners, in no particular order.
    #[must_use]
    pub fn as_slice(&self) -> &[Corner] {
        &self.corners
    }

    /// Corners and candidates lost because a buffer was full. 0 means that the search was complete.
    #[must_use]
    pub fn dropped(&self) -> u32 {
        self.dropped
    }

    /// Whether there is a corner within [`SEPARATION_PX`].
    pub(super) fn has_near(&self, position_px: [f32; 2]) -> bool {
        self.corners.iter().any(|corner| is_near(corner.position_px, position_px))
    }

    /// Adds a corner. Of two within 3 px of each other the stronger is kept; when the list is full
    /// the weakest is dropped.
    pub fn push(&mut self, corner: Corner) {
        let mut others = self.corners.iter_mut();
        if let Some(twin) = others.find(|other| is_near(other.position_px, corner.position_px)) {
            if corner.score > twin.score {
                *twin = corner;
            }
            return;
        }
        if let Err(corner) = self.corners.push(corner) {
            self.dropped = self.dropped.saturating_add(1);
            let weakest = self.corners.iter_mut().min_by(|a, b| a.score.total_cmp(&b.score));
            if let Some(weakest) = weakest.filter(|weakest| weakest.score < corner.score) {
                *weakest = corner;
            }
        }
    }

    /// Counts candidates that were lost to a full buffer before they were examined.
    pub(super) fn count_dropped(&mut self, dropped: u32) {
        self.dropped = self.dropped.saturating_add(dropped);
    }
}

fn is_near(a: [f32; 2], b: [f32; 2]) -> bool {
    let (dx, dy) = (a[0] - b[0], a[1] - b[1]);
    dx * dx + dy * dy < SEPARATION_PX * SEPARATION_PX
}

#[cfg(test)]
mod tests {
    extern crate std;

    use std::boxed::Box;

    use super::*;

    fn corner(position_px: [f32; 2], score: f32) -> Corner {
        Corner { position_px, score, edges_rad: [0.0, 1.5] }
    }

    #[test]
    fn corners_nearer_than_3_px_are_one() {
        let mut list = Box::new(CornerList::new());
        list.push(corner([50.0, 40.0], 0.2));
        for ([dx, dy], is_near) in [
            ([0.0, 0.0], true),
            ([2.9, 0.0], true),
            ([-2.9, 0.0], true),
            ([0.0, 2.9], true),
            ([0.0, -2.9], true),
            ([2.0, -2.0], true),
            // Exactly three are not nearer than three.
            ([3.0, 0.0], false),
            ([0.0, -3.0], false),
            ([-2.2, 2.2], false),
            ([2.5, 2.5], false),
        ] {
            let place = [50.0 + dx, 40.0 + dy];
            assert_eq!(list.has_near(place), is_near, "{dx} {dy}");
            let mut both = Box::new(CornerList::new());
            both.push(corner([50.0, 40.0], 0.2));
            both.push(corner(place, 0.1));
            assert_eq!(both.as_slice().len(), if is_near { 1 } else { 2 }, "{dx} {dy}");
        }
        assert!(!CornerList::new().has_near([0.0, 0.0]));
    }

    #[test]
    fn of_two_that_are_one_the_stronger_is_kept_and_the_first_of_equals() {
        let mut list = Box::new(CornerList::new());
        list.push(corner([50.0, 40.0], 0.2));
        list.push(corner([51.0, 40.0], 0.1));
        list.push(corner([51.0, 40.0], 0.2));
        assert_eq!(list.as_slice(), [corner([50.0, 40.0], 0.2)]);
        list.push(corner([51.0, 40.0], 0.3));
        assert_eq!(list.as_slice(), [corner([51.0, 40.0], 0.3)]);
        assert_eq!(list.dropped(), 0);
    }

    #[test]
    fn whatever_a_full_buffer_costs_is_counted() {
        let mut list = Box::new(CornerList::new());
        for n in 0..CORNERS_MAX {
            list.push(corner([10.0 * n as f32, 0.0], 0.2));
        }
        assert_eq!(list.dropped(), 0);
        // One that is as strong as the others does not drive one of them out.
        list.push(corner([0.0, 100.0], 0.2));
        assert!(!list.has_near([0.0, 100.0]));
        assert_eq!(list.dropped(), 1);
        list.push(corner([0.0, 100.0], 0.21));
        assert!(list.has_near([0.0, 100.0]));
        assert_eq!((list.as_slice().len(), list.dropped()), (CORNERS_MAX, 2));
        list.count_dropped(5);
        assert_eq!(list.dropped(), 7);
        list.count_dropped(u32::MAX);
        assert_eq!(list.dropped(), u32::MAX);
        list.clear();
        assert_eq!((list.as_slice().len(), list.dropped()), (0, 0));
    }
}
