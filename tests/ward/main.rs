//! A ward: many boxes, `plumb gateway`, and a real broker, Mosquitto, with TLS, users and an ACL.
//!
//! The boxes are played: they speak the sealed link as real ones do, by the same code, and say what a
//! healthy box with a swaying person says. Subscribers and commanders are Mosquitto's own programs.
//!
//! | what is done | what must come of it | where |
//! |---|---|---|
//! | a box, a trial by command, answers, wrong commands | states, a verdict, a summary; nothing of a person | [`published`] |
//! | the gateway is ended, killed, and started again | its last will; no trial without a verdict | [`ended`] |
//! | the broker is stopped and started in the middle | no verdict and no summary is missing, every state is there | [`away`] |
//! | wrong passwords, another authority, forbidden topics | it is said what to do | [`away`] |
//! | the desk's page, served by the gateway | the boxes as the desk shows them; nothing can be done with them | [`page`] |
//! | 10, 30, 100 boxes at 60 Hz | every pose is recorded; processor and memory for each box stay | [`load`] |

mod away;
mod bench;
mod boxes;
mod broker;
mod ended;
mod load;
mod page;
mod published;
