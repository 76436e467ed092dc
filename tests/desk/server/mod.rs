//! The desk's server without a browser: the real `plumb desk` and the box's real program, asked as a
//! page asks.
//!
//! | what is done | what must come of it | where |
//! |---|---|---|
//! | from a new box to a study's report | every step, by the routes alone | [`whole_way`] |
//! | sheets are printed, a box is made, heard and set up anew | the command line's own sheets; a box whole or not at all; its key to the page alone | [`new_box`] |
//! | the exposure is sought, stopped, sought again | the box is given one that suits its lamp, and is aimed on | [`exposure`] |
//! | foreign origins and hosts, no cookie, forms, long and senseless bodies and messages | nothing is told, nothing begins | [`hostile`] |
//! | another computer, with and without the password | TLS alone, and guesses are bounded | [`others`] |
//! | eight pages, half of which take nothing; the desk is killed in a trial | the trial is whole; the session goes on | [`pages`] |
//! | a box at the end of a serial cable | its picture, and a whole trial; unplugged, it is missed | [`serial`] |
//! | three boxes are recorded, and one is unplugged | the others do not notice | [`boxes`] |
//! | another program reads lines of JSON, and marks t = 0 | every frame, and the mark | [`streams`] |
//! | a laboratory takes the frames, and marks t = 0 | every frame, and the mark where its clock had it | [`lab`] |
//! | ten minutes at 200 Hz (ignored: it takes as long) | no memory is taken | [`memory`] |

mod boxes;
mod client;
mod exposure;
mod hostile;
mod lab;
mod memory;
mod new_box;
mod others;
mod pages;
mod protocol;
mod serial;
mod streams;
mod whole_way;
