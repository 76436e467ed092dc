//! The screen in every size.

use plumbline_bedside::recording::{Along, Judgement, Movement, NotYet, TrailPoint, TrunkFigures};

use super::*;

const MONOCHROME: Looks = Looks { glyphs: ASCII, is_coloured: false };

fn shown() -> Shown {
    let along = |now_mm, low_mm, high_mm| Along { now_mm, range_mm: Some([low_mm, high_mm]) };
    let upper = [along(4.0, -8.0, 10.0), along(-3.0, -5.0, 4.0), along(0.0, -0.4, 0.3)];
    // Half a minute of a slow circle that ends at its foremost.
    let trail = (0..600).map(|at| {
        let ago_s = 0.05 * f64::from(599 - at);
        let (ml, ap) = (0.2 * std::f64::consts::TAU * ago_s).sin_cos();
        TrailPoint { ago_s, position_mm: [8.0 * ap, 4.0 * ml, 0.0] }
    });
    let figures = TrunkFigures {
        rate_hz: 60.0,
        seconds: 42.0,
        samples: 2500,
        path_mm: 512.34,
        noise_path_mm: Some(21.7),
        rms_mm: [5.123, 2.5, 0.25],
        gaps: 2,
        gaps_s: 0.31,
    };
    let seen = Seen {
        judgement: Judgement {
            word: Some(Word::Look),
            reasons: ["first", "second", "third", "fourth"].map(|it| Why::new(it, "mend")).to_vec(),
        },
        elapsed: Duration::from_secs(42),
        remaining: Some(Duration::from_secs_f64(17.3)),
        time: "42 s since t = 0, 17 s to go of 60 s".to_owned(),
        movement: vec![
            Movement { trunk: "upper", along: Ok(upper), trail: trail.collect() },
            Movement { trunk: "lower", along: Err("not seen"), trail: Vec::new() },
        ],
        since: "since t = 0",
        counts: ["59.9 of 60 Hz", "2 lost (0.1 %)", "2520 frames"].map(str::to_owned).to_vec(),
        figures: vec![("upper", Ok(figures)), ("lower", Err(NotYet::Settling))],
    };
    let title = vec!["trials/p01".to_owned(), "participant P01".to_owned()];
    Shown { title, seen, typed: Some("tur".to_owned()) }
}

fn buffer(shown: &Shown, [columns, height]: [u16; 2], looks: Looks) -> Buffer {
    let news: Vec<String> = (0..30).map(|at| format!("news {at}")).collect();
    let mut buffer = Buffer::empty(Rect::new(0, 0, columns, height));
    draw(shown, &news, &mut buffer, looks);
    buffer
}

/// The rows as they are read, without what is blank at their ends.
fn text(buffer: &Buffer) -> Vec<String> {
    let columns = usize::from(buffer.area.width).max(1);
    let rows = buffer.content.chunks(columns);
    let text =
        |row: &[ratatui::buffer::Cell]| row.iter().map(|cell| cell.symbol()).collect::<String>();
    rows.map(|row| text(row).trim_end().to_owned()).collect()
}

fn drawn(shown: &Shown, size: [u16; 2]) -> Vec<String> {
    text(&buffer(shown, size, MONOCHROME))
}

#[test]
fn no_size_is_too_small() {
    let mut wide = shown();
    wide.title.push("参加者の名前".repeat(20));
    let seen = Seen { movement: Vec::new(), remaining: None, ..shown().seen };
    let empty = Shown { seen, typed: None, ..shown() };
    for shown in [shown(), wide, empty] {
        for columns in (0..40).chain([60, 79, 80, 81, 120, 139]) {
            for height in (0..30).chain([40, 49]) {
                for glyphs in [ASCII, BLOCKS] {
                    let looks = Looks { glyphs, is_coloured: true };
                    buffer(&shown, [columns, height], looks);
                }
            }
        }
    }
}

#[test]
fn the_more_room_the_more_is_shown_and_the_verdict_is_the_last_to_go() {
    let has = |rows: &[String], text: &str| rows.iter().any(|row| row.contains(text));
    let big = &big::lines("LOOK", '#')[0];
    // Columns and rows; large letters; bars; the trunks from above and over time; figures; the prompt.
    for (size, is_big, has_bars, is_from_above, is_over_time, has_figures, has_prompt) in [
        ([120, 40], true, true, true, true, true, true),
        ([80, 24], true, true, true, false, true, true),
        ([60, 15], false, true, false, false, false, true),
        ([40, 10], false, false, false, false, true, true),
        ([40, 5], false, false, false, false, false, false),
        ([20, 2], false, false, false, false, false, false),
    ] {
        let rows = drawn(&shown(), size);
        assert_eq!(rows.iter().any(|row| row.starts_with(big.trim_end())), is_big, "{size:?}");
        assert_eq!(has(&rows, "upper AP "), has_bars, "{size:?}: {rows:#?}");
        assert_eq!(has(&rows, "from above, +-10 mm"), is_from_above, "{size:?}: {rows:#?}");
        assert_eq!(has(&rows, "upper: AP line, ML dots"), is_over_time, "{size:?}: {rows:#?}");
        assert_eq!(has(&rows, "upper path 512.3 mm (noise 21.7)"), has_figures, "{size:?}");
        assert_eq!(has(&rows, "mark: tur"), has_prompt, "{size:?}");
        assert!(is_big || has(&rows, "LOOK"), "{size:?}");
        assert!(size[1] < 2 || has(&rows, "first"), "{size:?}");
        assert!(!has_bars || has(&rows, "range 18.0"), "{size:?}: {rows:#?}");
        assert!(!has_bars || has(&rows, "lower AP not seen"), "{size:?}: {rows:#?}");
    }
    assert_eq!(drawn(&shown(), [30, 1]), [" LOOK   0:42   0:18 to go"]);
    assert!(has(&drawn(&shown(), [40, 10]), "(and 3 more) first"));
    // With room for it, also what can be done; all of the figures fit on every usual terminal.
    assert!(has(&drawn(&shown(), [120, 40]), "first: mend"));
    let rows = drawn(&shown(), [80, 24]);
    assert!(has(&rows, "RMS AP 5.12 ML 2.50 SI 0.25, gaps 2 (0.3 s)"), "{rows:#?}");
    assert!(has(&rows, "lower figures: half a second without a gap is needed"));
}

#[test]
fn without_colour_everything_is_there_and_nothing_has_one() {
    for glyphs in [ASCII, BLOCKS] {
        let [plain, coloured] = [false, true]
            .map(|is_coloured| buffer(&shown(), [120, 40], Looks { glyphs, is_coloured }));
        assert_eq!(text(&plain), text(&coloured));
        let has_colour = |buffer: &Buffer| {
            buffer.content.iter().any(|cell| (cell.fg, cell.bg) != (Color::Reset, Color::Reset))
        };
        assert!(has_colour(&coloured) && !has_colour(&plain));
    }
    // A terminal without Unicode gets none.
    assert!(drawn(&shown(), [120, 40]).iter().all(|row| row.is_ascii()));
}

#[test]
fn the_trunk_is_where_it_is_from_above_and_its_letter_says_which() {
    let rows = drawn(&shown(), [120, 40]);
    let title = rows.iter().position(|row| row.contains("from above")).unwrap();
    // Straight ahead, near the upper end: the column of the axis, above the middle.
    let at = |row: &String| row[94..].find('U').map(|at| 94 + at);
    let row = rows[title + 1..title + 7].iter().position(|row| at(row).is_some()).unwrap();
    let column = at(&rows[title + 1 + row]).unwrap();
    assert!(row < 2 && (105..109).contains(&column), "{row} {column}: {rows:#?}");
}

#[test]
fn what_is_too_long_for_a_row_goes_on_in_the_next_or_ends_with_a_sign() {
    let long = "no frame has a position along the body's axes: the box did not know the way";
    let mut shown = shown();
    shown.seen.judgement.reasons = vec![Why::new(long, ""), Why::new("second", "")];
    let rows = drawn(&shown, [60, 15]);
    assert_eq!(rows[3], "no frame has a position along the body's axes: the box did");
    assert_eq!(rows[4], "(and 1 more) not know the way");
    let rows = rows_of_news(&[long, "last"], [60, 20]);
    assert_eq!(rows, [&long[..58], "not know the way", "last"]);
    assert_eq!(wrapped("a  b", 9).concat(), "a  b");
    assert_eq!(drawn(&shown, [12, 8])[0], "trials/p01,~");
}

fn rows_of_news(news: &[&str], [columns, height]: [usize; 2]) -> Vec<String> {
    let news: Vec<String> = news.iter().map(ToString::to_string).collect();
    let rows = news_rows(&news, height, columns).into_iter();
    rows.map(|row| row.to_string()).filter(|row| !row.is_empty()).collect()
}

#[test]
fn what_remains_is_large_where_it_fits() {
    // The middle row of the large letters.
    let has = |size, text| {
        let line = big::lines(text, '#')[2].trim_end().to_owned();
        drawn(&shown(), size).iter().any(|row| row.ends_with(&line))
    };
    assert!(has([120, 40], "0:42 -0:18"));
    assert!(has([80, 24], "0:42") && !has([80, 24], "0:42 -0:18"));
}

#[test]
fn control_characters_are_left_out() {
    let mut shown = shown();
    shown.title = vec!["ST\u{1b}[2JOP".to_owned()];
    assert_eq!(drawn(&shown, [80, 24])[0], "ST[2JOP");
}
