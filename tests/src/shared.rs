//! Where meshes for tests are that the project doesn't hold: beside it, or where `QUADMUSE_SHARED` says.

use std::path::PathBuf;

/// The folder, if it is there.
pub fn folder() -> Option<PathBuf> {
    let given = std::env::var_os("QUADMUSE_SHARED").map(PathBuf::from);
    let beside = || crate::walls::tree::root().parent().map(|parent| parent.join("shared"));
    given.or_else(beside).filter(|folder| folder.join("meshes").is_dir())
}

/// The folder; says on standard error what is left out if it is absent.
pub fn folder_or_say(what: &str) -> Option<PathBuf> {
    let found = folder();
    if found.is_none() {
        eprintln!("no shared meshes at ../shared or QUADMUSE_SHARED: {what} is left out");
    }
    found
}

/// The rows of a table in CSV (RFC 4180), each as pairs of column and value.
pub fn csv(text: &str) -> Vec<Vec<(String, String)>> {
    let mut records = csv_records(text).into_iter();
    let header = records.next().unwrap_or_default();
    records.map(|record| header.iter().cloned().zip(record).collect()).collect()
}

fn csv_records(text: &str) -> Vec<Vec<String>> {
    let (mut records, mut record, mut field) = (Vec::new(), Vec::new(), String::new());
    let mut quoted = false;
    let mut rest = text.chars().peekable();
    while let Some(c) = rest.next() {
        match c {
            '"' if quoted && rest.peek() == Some(&'"') => {
                rest.next();
                field.push('"');
            }
            '"' => quoted = !quoted,
            ',' if !quoted => record.push(std::mem::take(&mut field)),
            '\n' if !quoted => {
                record.push(std::mem::take(&mut field));
                records.push(std::mem::take(&mut record));
            }
            '\r' if !quoted => {}
            c => field.push(c),
        }
    }
    if !field.is_empty() || !record.is_empty() {
        record.push(field);
        records.push(record);
    }
    records
}

/// The value of a column; empty if there is none.
pub fn column<'a>(row: &'a [(String, String)], name: &str) -> &'a str {
    row.iter().find(|(column, _)| column == name).map_or("", |(_, value)| value.as_str())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quoted_fields_may_hold_commas_quotes_and_line_ends() {
        let rows = csv("a,b\n1,\"x, \"\"y\"\"\nz\"\n2,\n");
        assert_eq!(rows.len(), 2);
        assert_eq!((column(&rows[0], "a"), column(&rows[0], "b")), ("1", "x, \"y\"\nz"));
        assert_eq!((column(&rows[1], "b"), column(&rows[1], "c")), ("", ""));
    }
}
