//! quadmuse-store
