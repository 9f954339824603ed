//! quadmuse-proto
