//! What several of the other groups need, and what is no part of the measurement itself: the
//! [`checksum`] of packets and configurations, and the means and medians of [`statistics`].

pub(crate) mod checksum;
pub(crate) mod statistics;
