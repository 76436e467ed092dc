//! A box and its hosts on a network that loses, repeats and damages packets, and in which strangers
//! listen, forge addresses, play back what they have recorded, and flood. The programs are the real
//! ones: the box's, which shows a rendered person to itself, and `plumb`; between them lies a relay.
//!
//! | what is done | what must come of it | where |
//! |---|---|---|
//! | B1, B2 packets under the host's address: recorded, damaged, truncated, of other sessions | no command is done, no pose is missing, the configuration stays | [`attacks`] |
//! | B3 a recorded provisioning is played back, in the same start and in a later one | nothing is stored | [`attacks`] |
//! | B4 listening during `plumb aim` | no pose, picture, name, key or configuration can be read | [`attacks`] |
//! | B5, B9 a box without a key announces itself beside the box | one trial, of the one box | [`attacks`] |
//! | B6 a stranger's packets before the box starts; B7, B8 takeovers under the box's address, and announcements that it has started again | not in the trial; counted as not authentic | [`attacks`] |
//! | B12, B17 numbers that cannot be true | nobody without the key can send one | [`attacks`] |
//! | B13 a mark of another program on the host's computer | taken | [`attacks`] |
//! | B13 marks of another computer, under its own address and under this one's | refused and counted unless it is named; then its name is beside the mark | [`elsewhere`] |
//! | all of it by a computer that every packet passes | reads nothing, changes nothing | [`elsewhere`] |
//! | commands sealed with another box's key | not taken; no more bytes come back than were sent | [`attacks`] |
//! | B10 5, 20 and 40 % of the packets lost, and all of them for 5 s and for 50 s | no pose missing, and the same figures as undisturbed, bit by bit | [`loss`] |
//! | B11 a tenth repeated, and a tenth 2.5 s late; a twentieth damaged | the same | [`loss`] |
//! | more lost than the box keeps | what is lost is counted exactly, and said | [`loss`] |
//! | box and host start again | listened to within 2 s, nothing counted twice | [`restarts`] |
//! | another configuration is sent while somebody records | refused with his name, done by force | [`sharing`] |
//! | B14 50,000 datagrams of junk a second at the box, at a host | no pose lost, no memory taken, no junk kept | [`floods`] |
//! | another receiver, in Python, written from LINK.md | the same poses; it makes and opens the published packets | [`python`], [`vectors`] |
//! | other programs take the poses while they come, many at once, idle ones, one that goes away | every frame, with true times; the recording is whole | [`streams`] |
//! | killed while recording, dead links, full disks, clocks that jump, a hundred times each | what was recorded is there until then; nothing that was sent is missing | [`endurance`] |
//!
//! B15 and B16 and B18 to B20 are not of the link: updates, files and terminals have tests of their
//! own. A box as strangers find it on a serial cable is tested with the box's program.

mod attacks;
mod bench;
mod elsewhere;
mod endurance;
mod floods;
mod loss;
mod network;
mod python;
mod relay;
mod restarts;
mod sharing;
mod streams;
mod vectors;
