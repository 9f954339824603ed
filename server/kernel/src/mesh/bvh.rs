//! Closest points (to come).
