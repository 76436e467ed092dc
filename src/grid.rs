//! Corners -> indexed grids.
