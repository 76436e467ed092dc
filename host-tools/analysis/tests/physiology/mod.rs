//! ECGs, pressures and CO2 whose beats and breaths are known.

mod ecg;
mod heart;
mod pressure;
mod respiration;
mod stand;
