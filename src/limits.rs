//! Every capacity of the pipeline, in one place, and the relations between
//! them, checked when the crate is compiled.
//!
//! The capacities that determine the pipeline's memory come in two sets; the feature `small-limits`
//! selects the smaller one, for a microcontroller. As long as neither set overflows, both give the
//! same poses. Packets have the same shape with both.

/// The capacities that differ between the two sets.
struct Capacities {
    target_corners: usize,
    corners: usize,
    lens_table_cells: usize,
    search_pixels_per_step: usize,
}

/// For frames of 1456 x 1088. A 13 x 9 calibration board fits.
const STANDARD: Capacities = Capacities {
    target_corners: 120,
    corners: 1024,
    lens_table_cells: 16,
    search_pixels_per_step: 128 * 1024,
};

/// For frames of 640 x 480. A board of 8 x 6 corners fits.
const SMALL: Capacities = Capacities {
    target_corners: 48,
    corners: 384,
    lens_table_cells: 10,
    search_pixels_per_step: 25 * 1024,
};

const SELECTED: Capacities = if cfg!(feature = "small-limits") { SMALL } else { STANDARD };

/// Largest number of targets tracked at once: shoulder, lumbar, scene board.
pub const TARGETS_MAX: usize = 3;

/// Largest number of corners of one target.
pub const TARGET_CORNERS_MAX: usize = SELECTED.target_corners;

/// Largest frame side. The memory does not depend on it; the duration of a full search does.
pub const FRAME_SIDE_PX_MAX: u16 = 4096;

/// Smallest frame side: a detector kernel must fit with room to spare.
pub const FRAME_SIDE_PX_MIN: u16 = 64;

/// Columns of the longest grid, which has 3 rows. Among all grids with the same number of corners
/// it has the most nodes, edges and squares.
const GRID_COLUMNS_MAX: usize = TARGET_CORNERS_MAX / 3;

/// Grid lines of the longest grid.
const GRID_LINES_MAX: usize = GRID_COLUMNS_MAX + 3;

/// Nodes of one target, see [`Nodes`](crate::parts::Nodes): (columns + 2) x (rows + 2).
pub const TARGET_NODES_MAX: usize = (GRID_COLUMNS_MAX + 2) * 5;

/// Edges of one target: two per corner, one more per line, and those of the dark squares at the
/// border, which are half of its 2 (lines + 2) sides of squares.
pub const TARGET_EDGES_MAX: usize = 2 * TARGET_CORNERS_MAX + GRID_LINES_MAX + (GRID_LINES_MAX + 2);

/// Squares of one colour of one target: half of (columns + 1) x (rows + 1).
pub const TARGET_SQUARES_MAX: usize = (GRID_COLUMNS_MAX + 1) * 4 / 2;

/// Largest number of observations for one pose: every edge of a target.
pub const OBSERVATIONS_MAX: usize = TARGET_EDGES_MAX;

// A node's index is a byte, and a set of corners is the bits of a u128.
const _: () = assert!(TARGET_NODES_MAX <= 256 && TARGET_CORNERS_MAX <= 128);

// The longest grid has exactly the largest number of corners.
const _: () = assert!(GRID_COLUMNS_MAX * 3 == TARGET_CORNERS_MAX);

/// Cells along each side of the map from rays to raw pixels in a
/// [`LensTable`](crate::lens_table::LensTable), and twice those of the map back.
pub const LENS_TABLE_CELLS: usize = SELECTED.lens_table_cells;

/// Pixels that a search examines in one step while another target is tracked: a twelfth of a frame,
/// so that a sweep of the whole frame takes less than a quarter of a second at 60 Hz.
pub const SEARCH_PIXELS_PER_STEP: usize = SELECTED.search_pixels_per_step;

/// Longest name of a target, in bytes.
pub const NAME_BYTES_MAX: usize = 16;

/// Longest device name, serial number or firmware version, in bytes.
pub const DEVICE_TEXT_BYTES_MAX: usize = 24;

/// Largest number of corners that a search of a frame keeps: the strongest ones.
pub const CORNERS_MAX: usize = SELECTED.corners;

// There is room for the corners of all targets and for as many spurious ones; a corner's index
// takes two bytes.
const _: () = assert!(2 * TARGETS_MAX * TARGET_CORNERS_MAX <= CORNERS_MAX && CORNERS_MAX < 65_536);

/// Packets of the stream that a box keeps for listeners that have missed some: a minute at 200 Hz,
/// and the other messages of that minute.
pub const RING_PACKETS: usize = 12_288;

/// Bytes of the ring in which they are kept: a minute at 200 Hz of the longest sealed packets of two
/// targets, which with their length take 191 bytes as long as their counter has four, that is for
/// the first two weeks. Packets of three targets are kept for two thirds of that, and at 60 Hz any
/// are kept for much longer.
pub const RING_BYTES: usize = 12_000 * 192;

#[cfg(test)]
mod tests {
    use super::*;

    /// The shapes of all grids that a target can have.
    fn shapes() -> impl Iterator<Item = [usize; 2]> {
        (3..=TARGET_CORNERS_MAX)
            .flat_map(|columns| (3..=TARGET_CORNERS_MAX / columns).map(move |rows| [columns, rows]))
    }

    /// The edges of a grid, each between two neighbouring squares of different colour, counted one by
    /// one. Around the squares of the grid is white paper.
    fn edges([columns, rows]: [usize; 2], first_square_dark: bool) -> usize {
        let is_dark = |column: usize, row: usize| {
            let is_square = (1..=columns + 1).contains(&column) && (1..=rows + 1).contains(&row);
            is_square && ((column + row).is_multiple_of(2) == first_square_dark)
        };
        let mut count = 0;
        for (column, row) in
            (0..=columns + 1).flat_map(|it| (0..=rows + 1).map(move |row| (it, row)))
        {
            let here = is_dark(column, row);
            count += usize::from(here != is_dark(column + 1, row));
            count += usize::from(here != is_dark(column, row + 1));
        }
        count
    }

    #[test]
    fn no_grid_needs_more_room_than_the_longest_one() {
        let nodes = shapes().map(|[columns, rows]| (columns + 2) * (rows + 2)).max();
        assert_eq!(nodes, Some(TARGET_NODES_MAX));
        // Where their number is odd, there is one more of one colour.
        let squares =
            shapes().map(|[columns, rows]| ((columns + 1) * (rows + 1)).div_ceil(2)).max();
        assert_eq!(squares, Some(TARGET_SQUARES_MAX));
        let edges = shapes().flat_map(|shape| [true, false].map(|dark| edges(shape, dark))).max();
        assert_eq!(edges, Some(TARGET_EDGES_MAX));
    }

    #[test]
    fn twelve_steps_of_a_search_are_a_frame() {
        for (capacities, frame_pixels) in [(&STANDARD, 1456 * 1088), (&SMALL, 640 * 480)] {
            let share = (12 * capacities.search_pixels_per_step) as f64 / f64::from(frame_pixels);
            // 128 KiB is 0.7 % less.
            assert!((0.99..=1.0).contains(&share), "{share}");
        }
    }

    #[test]
    fn the_ring_holds_a_minute_at_200_hz() {
        const PACKETS: usize = 60 * 200;
        // Rounded up to a multiple of 1,024.
        assert_eq!(PACKETS.next_multiple_of(1024), RING_PACKETS);
        // With their length; and not a hundredth more than that.
        let needed = PACKETS * 191;
        assert!((needed..needed + needed / 100).contains(&RING_BYTES));
    }
}
