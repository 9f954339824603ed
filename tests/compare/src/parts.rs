//! Parts that surfaces are cut into: of every mesh at hand, and of one shape in several forms.

pub mod file;
pub mod row;
pub mod stability;
