//! Maps with a known truth, by several methods: an example, the same shape in another form as a scan, and where each
//! vertex of the example belongs on it.

pub mod case;
pub mod cut;
pub mod derived;
pub mod lay;
pub mod loaded;
pub mod method;
pub mod sharp;
pub mod table;
