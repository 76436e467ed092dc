extern crate std;

use std::boxed::Box;
use std::vec::Vec;

use super::*;

/// The response at one pixel of a picture of bytes, by the definition.
fn plain(bytes: &[u8], width: usize, height: usize, x: usize, y: usize) -> u8 {
    let at = |dx: i32, dy: i32| {
        let column = (x as i32 + dx).clamp(0, width as i32 - 1) as usize;
        let row = (y as i32 + dy).clamp(0, height as i32 - 1) as usize;
        i32::from(bytes[row * width + column])
    };
    let mean = |values: &[i32]| {
        let mut values = values.to_vec();
        while values.len() > 1 {
            values = values.chunks(2).map(|pair| (pair[0] + pair[1] + 1) / 2).collect();
        }
        values[0]
    };
    let half = [(4, 0), (3, 3), (0, 4), (-3, 3), (4, 2), (2, 4), (-2, 4), (-4, 2)];
    let pairs: Vec<_> = half.iter().map(|&(x, y)| mean(&[at(x, y), at(-x, -y)])).collect();
    let odd: Vec<_> = half.iter().map(|&(x, y)| (at(x, y) - at(-x, -y)).abs()).collect();
    let quarters: Vec<_> = [0, 1, 4, 5].iter().map(|&n| (pairs[n] - pairs[n + 2]).abs()).collect();
    let signal = mean(&quarters);
    let centre = mean(&[at(-1, 0), at(1, 0), at(0, -1), at(0, 1)]);
    let disorder = mean(&odd) + (mean(&pairs) - centre).abs();
    let promises = quarters[0].max(quarters[1]) > mean(&odd[..4]) + 4;
    if !promises || (2 * disorder).min(255) > (signal + 4).min(255) {
        return 0;
    }
    (signal - disorder - 4).max(0) as u8
}

#[test]
fn the_ring_is_its_definition_at_every_pixel_of_odd_tiles() {
    let (width, height) = (97, 83);
    let mut random = crate::find::corner::tests::Random(3);
    // Coarse blocks, so that corners occur.
    let bytes: Vec<u8> = (0..width * height)
        .map(|n| {
            let block = (n % width / 7 + n / width / 6) % 2;
            (200.0 * block as f64 + 40.0 * random.next()) as u8
        })
        .collect();
    let image = GreyImage::new(&bytes, width, height, width).unwrap();
    let mut tile = Box::new(Tile::new());
    let mut positive = 0;
    let tiles = [(0, 0, 50, 41), (50, 0, 47, 41), (0, 41, 97, 42), (13, 29, 17, 1)];
    // Widths of which the last pixels need one more block of lanes, or not.
    let widths = (26..34).map(|w| (31 + w % 5, 7, w, 30));
    for (x0, y0, w, h) in tiles.into_iter().chain(widths) {
        let (candidates, _) = tile.search(&image, 0, [x0, y0], [w, h]);
        let candidates = candidates.to_vec();
        let is_in_tile = |it: &Candidate| {
            (x0..x0 + w).contains(&it.x.into()) && (y0..y0 + h).contains(&it.y.into())
        };
        assert!(candidates.iter().all(is_in_tile), "{candidates:?}");
        let response = |x: usize, y: usize| plain(&bytes, width, height, x, y);
        for y in y0..y0 + h {
            for x in x0..x0 + w {
                let fast = tile.responses[y - y0 + MAXIMUM].as_flattened()[x - x0 + MAXIMUM];
                assert_eq!(fast, response(x, y), "{x} {y}");
                positive += usize::from(fast > 0);
                let mut higher = 0;
                let mut equal = 0;
                for dy in 0..=2 * MAXIMUM {
                    for dx in 0..=2 * MAXIMUM {
                        let other = tile.responses[y - y0 + dy].as_flattened()[x - x0 + dx];
                        higher += usize::from(other > fast);
                        equal += usize::from(other == fast);
                    }
                }
                let is_candidate = candidates.contains(&Candidate { x: x as u16, y: y as u16 });
                // Of equal neighbours the first is the candidate.
                if fast == 0 || higher > 0 {
                    assert!(!is_candidate, "{x} {y}");
                } else if equal == 1 {
                    assert!(is_candidate, "{x} {y}");
                }
            }
        }
    }
    assert!(positive > 100, "{positive}");
}

#[test]
fn a_response_begins_at_the_least_contrast_and_signal() {
    // Rings side by side whose first half has little more contrast than disorder, or little less, and
    // whose other half shows a corner, or nearly.
    const SIDE: usize = 9;
    const COUNT: usize = 50;
    const WIDTH: usize = SIDE * COUNT;
    const HEIGHT: usize = 64;
    const MIDDLE: i32 = 100;
    let mut random = crate::test_support::Random::new(7);
    let mut tile = Box::new(Tile::new());
    let mut at_the_bound = [0; 3];
    for _ in 0..40 {
        let mut bytes = std::vec![MIDDLE as u8; WIDTH * HEIGHT];
        let mut excess = [0; COUNT];
        for (n, excess) in excess.iter_mut().enumerate() {
            let mut set = |[x, y]: [i32; 2], value: i32| {
                let (column, row) = ((n * SIDE + 4) as i32 + x, 4 + y);
                bytes[row as usize * WIDTH + column as usize] = value as u8;
            };
            let mut below = |end: u64| (random.bits() % end) as i32;
            let (contrast, odd) = (6 + below(12), below(10));
            for (pair, [x, y]) in [[4, 0], [3, 3], [0, 4], [-3, 3]].into_iter().enumerate() {
                let level = MIDDLE + [contrast, 0][pair / 2];
                set([x, y], level + odd);
                set([-x, -y], level);
            }
            let (contrast_between, odd_between) = (6 + below(20), below(3));
            for (pair, [x, y]) in [[4, 2], [2, 4], [-2, 4], [-4, 2]].into_iter().enumerate() {
                let level = MIDDLE + [contrast_between, 0][pair / 2];
                set([x, y], level + odd_between);
                set([-x, -y], level);
            }
            let level = (contrast + contrast_between) / 4 + (odd + odd_between) / 4;
            for [x, y] in [[1, 0], [-1, 0], [0, 1], [0, -1]] {
                set([x, y], MIDDLE + level);
            }
            *excess = contrast - odd;
        }
        let image = GreyImage::new(&bytes, WIDTH, HEIGHT, WIDTH).unwrap();
        tile.search(&image, 0, [0, 0], [WIDTH, HEIGHT]);
        for (n, excess) in excess.into_iter().enumerate() {
            let (x, y) = (n * SIDE + 4, 4);
            let fast = tile.responses[y + MAXIMUM].as_flattened()[x + MAXIMUM];
            assert_eq!(fast, plain(&bytes, WIDTH, HEIGHT, x, y), "{n}");
            assert!(fast == 0 || excess >= i32::from(RESPONSE_MIN), "{n}: {fast} {excess}");
            if fast > 0
                && let Some(count) = at_the_bound.get_mut((excess - 5) as usize)
            {
                *count += 1;
            }
        }
    }
    assert!(at_the_bound.iter().all(|count| *count > 10), "{at_the_bound:?}");
}

#[test]
fn the_half_size_is_the_mean_of_four() {
    let mut random = crate::find::corner::tests::Random(4);
    for length in [1, 15, 16, 17, 41] {
        let rows: [Vec<u16>; 2] =
            [0, 1].map(|_| (0..2 * length).map(|_| (random.next() * 1100.0) as u16).collect());
        let mut bytes = std::vec![0; length];
        fill_half(&mut bytes, &rows[0], &rows[1], shift_to_bytes(1023));
        for (n, byte) in bytes.into_iter().enumerate() {
            // As bytes; rounded up first by columns and then along the row.
            let column = |x: usize| {
                let [upper, lower] = [0, 1].map(|row| u32::from(rows[row][x] / 4).min(255));
                (upper + lower).div_ceil(2)
            };
            let mean = (column(2 * n) + column(2 * n + 1)).div_ceil(2);
            assert_eq!(u32::from(byte), mean, "{n} of {length}");
        }
    }
}

#[test]
fn means_are_rounded_up() {
    for a in 0..=255_u8 {
        for b in 0..=255_u8 {
            let mean = (u32::from(a) + u32::from(b)).div_ceil(2);
            assert_eq!(u32::from(mean_of_2(a, b)), mean, "{a} {b}");
        }
    }
}

#[test]
fn white_becomes_at_most_255_and_more_than_127() {
    for (white, shift) in
        [(1, 0), (255, 0), (256, 1), (511, 1), (512, 2), (1023, 2), (4095, 4), (65535, 8)]
    {
        assert_eq!(shift_to_bytes(white), shift, "{white}");
    }
    assert_eq!(to_byte(1023_u16, 2), 255);
    assert_eq!(to_byte(511_u16, 2), 127);
    let mut bytes = [0; 4];
    fill_whole(&mut bytes, &[0_u16, 511, 512, 1023], 2);
    assert_eq!(bytes, [0, 127, 128, 255]);
    fill_whole(&mut bytes, &[0_u8, 1, 254, 255], 0);
    assert_eq!(bytes, [0, 1, 254, 255]);
    // Above white.
    assert_eq!(to_byte(1024_u16, 2), 255);
    assert_eq!(to_byte(u16::MAX, 0), 255);
}

#[test]
fn a_block_stands_for_its_columns() {
    let columns: Vec<usize> = columns_of(0b1001).collect();
    assert!(columns.into_iter().eq((0..16).chain(48..64)));
    assert_eq!(columns_of(0).count(), 0);
    assert_eq!(columns_of(1 << 32).next(), Some(512));
}

/// Blocks of random brightness, which give corners of every contrast.
fn blocks(width: usize, height: usize, side: usize, seed: u64) -> Vec<u8> {
    let mut random = crate::test_support::Random::new(seed);
    let across = width / side + 1;
    let levels: Vec<u8> = (0..across * (height / side + 1))
        .map(|n| match n % 3 {
            0 => random.bits() as u8,
            _ => 255 * (random.bits() % 2) as u8,
        })
        .collect();
    let noise = [0, 3][seed as usize % 2];
    (0..width * height)
        .map(|n| {
            let level = levels[n / width / side * across + n % width / side];
            level.saturating_add((random.bits() % (1 + noise)) as u8)
        })
        .collect()
}

/// The maxima in reading order. Of equal neighbours the first is one.
fn plain_candidates(
    responses: impl Fn(isize, isize) -> u8,
    [x0, y0]: [usize; 2],
    [width, height]: [usize; 2],
) -> Vec<Candidate> {
    let mut candidates = Vec::new();
    for (y, x) in (0..height).flat_map(|y| (0..width).map(move |x| (y, x))) {
        let own = responses(x as isize, y as isize);
        let is_maximum = (0..25).all(|n| {
            let (dx, dy) = (n % 5 - 2, n / 5 - 2);
            let other = responses(x as isize + dx, y as isize + dy);
            if n < 12 { other < own } else { other <= own }
        });
        if own > 0 && is_maximum {
            candidates.push(Candidate { x: (x0 + x) as u16, y: (y0 + y) as u16 });
        }
    }
    candidates
}

#[test]
fn a_tile_gives_its_own_maxima_and_no_others() {
    let (width, height) = (90, 80);
    let mut tile = Box::new(Tile::new());
    let mut found = 0;
    for (seed, side) in [(1, 5), (2, 6), (3, 9), (4, 3)] {
        let bytes = blocks(width, height, side, seed);
        let image = GreyImage::new(&bytes, width, height, width).unwrap();
        // Responses beyond the frame are those of its repeated border.
        let padded: Vec<u8> = (0..(width + 4) * (height + 4))
            .map(|n| {
                let at = |place: usize, side: usize| place.saturating_sub(2).min(side - 1);
                let [x, y] = [at(n % (width + 4), width), at(n / (width + 4), height)];
                bytes[y * width + x]
            })
            .collect();
        for (x0, y0, w, h) in [(0, 0, 90, 64), (0, 64, 90, 16), (30, 20, 33, 17)] {
            let (candidates, dropped) = tile.search(&image, 0, [x0, y0], [w, h]);
            assert_eq!(dropped, 0);
            let responses = |x: isize, y: isize| {
                let [x, y] = [x + (x0 + 2) as isize, y + (y0 + 2) as isize];
                plain(&padded, width + 4, height + 4, x as usize, y as usize)
            };
            let expected = plain_candidates(responses, [x0, y0], [w, h]);
            assert_eq!(candidates, expected, "{seed}: {x0} {y0}");
            found += expected.len();
        }
    }
    assert!(found > 100, "{found}");
}

#[test]
fn half_the_size_is_searched_as_a_picture_of_half_the_size() {
    let (width, height) = (131, 138);
    let bytes = blocks(width, height, 11, 6);
    let image = GreyImage::new(&bytes, width, height, width).unwrap();
    let (half_width, half_height) = (width / 2, height / 2);
    let halved: Vec<u8> = (0..half_width * half_height)
        .map(|n| {
            let first = 2 * (n / half_width) * width + 2 * (n % half_width);
            let column = |x: usize| mean_of_2(bytes[first + x], bytes[first + width + x]);
            mean_of_2(column(0), column(1))
        })
        .collect();
    let half = GreyImage::new(&halved, half_width, half_height, half_width).unwrap();
    let mut tiles = [(); 2].map(|()| Box::new(Tile::new()));
    let mut found = 0;
    for (place, size) in [([0, 0], [65, 64]), ([0, 64], [65, 5]), ([17, 9], [20, 30])] {
        let [one, other] = &mut tiles;
        let (ours, theirs) =
            (one.search(&image, 1, place, size), other.search(&half, 0, place, size));
        assert_eq!(ours, theirs, "{place:?}");
        found += ours.0.len();
    }
    assert!(found > 10, "{found}");
}

#[test]
fn a_whole_tile_is_searched_and_what_it_cannot_hold_is_counted() {
    let (width, height) = (TILE_WIDTH, 70);
    let mut tile = Box::new(Tile::new());
    for (side, is_dropped) in [(8, false), (5, true)] {
        let bytes: Vec<u8> = (0..width * height)
            .map(|n| if (n % width / side + n / width / side) % 2 == 0 { 200 } else { 50 })
            .collect();
        let image = GreyImage::new(&bytes, width, height, width).unwrap();
        let (candidates, dropped) = tile.search(&image, 0, [0, 0], [width, TILE_HEIGHT]);
        // One where four squares meet, up and left of that.
        let corners = ((width - 1) / side) * (TILE_HEIGHT / side);
        if is_dropped {
            // One per 64 pixels.
            assert_eq!(candidates.len(), 512);
            assert_eq!(candidates.len() + dropped as usize, corners);
        } else {
            assert_eq!((candidates.len(), dropped), (corners, 0));
            let last = candidates[corners - 1];
            assert!(last.x >= 502 && last.y >= 54, "{last:?}");
        }
    }
}
