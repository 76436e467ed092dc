//! The desk's page in a real Chromium, against the real `plumb desk` and the box's real program, whose
//! camera shows rendered frames. Each script in Python drives the browser; the test beside it sets the
//! stage and judges what has come of it. With `PLUMBLINE_SHOTS=1` the scripts keep a picture of every step
//! in `target/tmp/desk`, to be looked at; a page on which a test fails is always kept there.
//!
//! | what is done | what must come of it | where |
//! |---|---|---|
//! | from the paper and a new box to a study's report, by mouse, and by keyboard alone | a study whose trials are whole | [`whole_way`] |
//! | every step at three sizes, light and dark | nothing is cut off, no command is named, axe-core finds nothing, the console is silent, no other host is asked | [`looks`] |
//! | the page is reloaded, throttled, cut off, closed and opened again in a trial | the trial is whole | [`disturbed`] |
//! | the picture fills the screen, photographs are taken by themselves, a trial begins and ends | it can be read from afar, and each tone is heard | [`heard`] |
//! | a page of another origin, another name for the desk, hostile words | nothing is got, nothing begins | [`hostile`] |
//! | the modules that draw are asked, and read | they draw what came; no text becomes markup | [`drawings`] |
//! | the routes are asked without a browser | see there | [`server`] |
//! | a person is watched | on the screen within a tenth of a second (said; asserted where the test is alone); no memory is taken | [`pace`] |

mod camera;
mod disturbed;
mod drawings;
mod heard;
mod hostile;
mod looks;
mod pace;
mod server;
mod stage;
mod stand;
mod whole_way;
