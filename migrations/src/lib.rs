//! quadmuse-migrations
