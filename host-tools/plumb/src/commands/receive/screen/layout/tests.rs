//! The screen in every size.

use plumbline_bedside::recording::Judgement;

use super::*;

fn shown() -> Shown {
    let along = |now_mm, low_mm, high_mm| Along { now_mm, range_mm: Some([low_mm, high_mm]) };
    let upper = [along(4.0, -8.0, 10.0), along(-3.0, -5.0, 4.0), along(0.0, -0.4, 0.3)];
    let seen = Seen {
        judgement: Judgement {
            word: Some(Word::Look),
            reasons: ["first", "second", "third", "fourth"].map(|it| Why::new(it, "mend")).to_vec(),
        },
        elapsed: Duration::from_secs(42),
        remaining: Some(Duration::from_secs_f64(17.3)),
        time: "42 s since t = 0, 17 s to go of 60 s".to_owned(),
        movement: vec![
            Movement { trunk: "upper", along: Ok(upper) },
            Movement { trunk: "lower", along: Err("not seen") },
        ],
        since: "since t = 0",
        counts: ["59.9 of 60 Hz", "2 lost (0.1 %)", "2520 frames"].map(str::to_owned).to_vec(),
    };
    let title = vec!["trials/p01".to_owned(), "participant P01".to_owned()];
    Shown { title, seen, typed: Some("tur".to_owned()) }
}

fn drawn(shown: &Shown, size: [usize; 2]) -> Vec<String> {
    let news: Vec<String> = (0..30).map(|at| format!("news {at}")).collect();
    let rows = rows(shown, &news, size, ASCII);
    rows.iter().map(|row| row.written(size[0], ASCII, false)).collect()
}

#[test]
fn no_size_is_too_small_and_nothing_is_wider_or_longer_than_the_terminal() {
    let mut wide = shown();
    wide.title.push("参加者の名前".repeat(20));
    let seen = Seen { movement: Vec::new(), remaining: None, ..shown().seen };
    let empty = Shown { seen, typed: None, ..shown() };
    for shown in [shown(), wide, empty] {
        for columns in 0..140 {
            for height in 0..50 {
                let rows = drawn(&shown, [columns, height]);
                assert_eq!(rows.len(), height, "{columns}x{height}");
                for row in rows {
                    assert!(width(&row) <= columns, "{columns}x{height}: {row}");
                }
            }
        }
    }
}

#[test]
fn the_more_room_the_larger_and_the_verdict_is_the_last_to_go() {
    let has = |rows: &[String], text: &str| rows.iter().any(|row| row.contains(text));
    let big = &big::lines("LOOK", '#')[0];
    let bar = "upper AP ";
    // Columns and rows; large letters; rows of bars; the range beside them; the prompt.
    for (size, is_big, bars, has_prompt) in [
        ([120, 40], true, 12, true),
        ([80, 24], true, 6, true),
        ([60, 15], false, 6, true),
        ([40, 10], false, 0, true),
        ([40, 5], false, 0, false),
        ([20, 2], false, 0, false),
    ] {
        let rows = drawn(&shown(), size);
        assert_eq!(rows.iter().any(|row| row.starts_with(big.trim_end())), is_big, "{size:?}");
        assert_eq!(rows.iter().any(|row| row.starts_with(bar)), bars > 0, "{size:?}");
        let thick = rows.iter().filter(|row| row.contains("--")).count();
        // Of the upper trunk only: the lower one is not seen.
        assert_eq!(2 * thick, bars, "{size:?}: {rows:#?}");
        assert_eq!(has(&rows, "mark: tur"), has_prompt, "{size:?}");
        assert!(is_big || has(&rows, "LOOK"), "{size:?}");
        assert!(size[1] < 2 || has(&rows, "first"), "{size:?}");
        assert!(bars == 0 || has(&rows, "range 18.0"), "{size:?}: {rows:#?}");
        assert!(bars == 0 || has(&rows, "lower AP not seen"), "{size:?}: {rows:#?}");
    }
    assert_eq!(drawn(&shown(), [30, 1]), [" LOOK   0:42   0:18 to go"]);
    assert!(has(&drawn(&shown(), [40, 10]), "(and 3 more) first"));
    // With room for it, also what can be done.
    assert!(has(&drawn(&shown(), [120, 40]), "first: mend"));
}

#[test]
fn what_is_too_long_for_a_row_goes_on_in_the_next() {
    let long = "no frame has a position along the body's axes: the box did not know the way";
    let mut shown = shown();
    shown.seen.judgement.reasons = vec![Why::new(long, ""), Why::new("second", "")];
    let rows = drawn(&shown, [60, 15]);
    assert_eq!(rows[3], "no frame has a position along the body's axes: the box did");
    assert_eq!(rows[4], "(and 1 more) not know the way");
    let rows = rows_of_news(&[long, "last"], [60, 20]);
    assert_eq!(rows, [&long[..58], "not know the way", "last"]);
    assert_eq!(wrapped("a  b", 9).concat(), "a  b");
}

fn rows_of_news(news: &[&str], [columns, height]: [usize; 2]) -> Vec<String> {
    let news: Vec<String> = news.iter().map(ToString::to_string).collect();
    let rows = news_rows(&news, height, columns).into_iter();
    rows.map(|row| row.written(columns, ASCII, false)).filter(|row| !row.is_empty()).collect()
}

#[test]
fn what_remains_is_large_where_it_fits() {
    // The middle row of the large letters.
    let clock = |columns| drawn(&shown(), [columns, 40])[4].clone();
    let large = |text| big::lines(text, '#')[2].trim_end().to_owned();
    assert!(clock(120).trim_end().ends_with(&large("0:42 -0:18")), "{}", clock(120));
    assert!(clock(80).trim_end().ends_with(&large("0:42")), "{}", clock(80));
}

#[test]
fn a_bar_shows_range_origin_and_place_on_its_scale() {
    let along = |now_mm, range_mm| Along { now_mm, range_mm };
    let bar = |along| drawn_bar(&along, 10.0);
    assert_eq!(bar(along(0.0, None)), "----------#----------");
    assert_eq!(bar(along(5.0, Some([-5.0, 7.0]))), "-----=====|====#==---");
    // Beyond the scale it stays at the end.
    assert_eq!(bar(along(9e9, Some([-9e9, 9e9]))), "==========|=========#");
    let movement = |now_mm| {
        let of = along(now_mm, None);
        vec![Movement { trunk: "upper", along: Ok([of; 3]) }]
    };
    for (furthest_mm, wanted_mm) in [(0.0, 5.0), (5.1, 10.0), (-31.0, 50.0), (9e9, 2000.0)] {
        assert_eq!(scale_mm(&movement(furthest_mm)), wanted_mm);
    }
    let scale = scale(10.0, 21, "since t = 0").written(99, ASCII, false);
    assert_eq!(scale.trim_start(), "-10       0         +10 mm  since t = 0");
}

fn drawn_bar(along: &Along, scale_mm: f64) -> String {
    super::drawn(along, scale_mm, 21, ASCII)
}

#[test]
fn colour_stands_beside_the_text_and_control_characters_are_left_out() {
    let row = colour(Word::Stop);
    let row = Row::default().and(row, "ST\u{1b}[2JOP");
    assert_eq!(row.written(20, ASCII, false), "ST[2JOP");
    assert_eq!(row.written(4, ASCII, false), "ST[~");
    let written = row.written(20, ASCII, true);
    assert!(written.starts_with("\u{1b}[1m\u{1b}[31mST[2JOP"), "{written:?}");
}
