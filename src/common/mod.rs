//! What several of the other folders need, but is not part of the measurement itself: the
//! [`checksum`] of packets and configurations, and the means and medians of [`statistics`].

pub(crate) mod checksum;
pub(crate) mod statistics;
