//! Checksums around everything that is written.
//!
//! A *frame* is a file's or a backup record's content: `magic ‖ length u64 LE ‖ payload ‖ blake3(magic ‖ length ‖ payload)[..16]`.
//! A *sealed value* is a row of the index: `payload ‖ blake3(tree ‖ key ‖ payload)[..8]`; the key takes part, so that a value that
//! turns up under another key is refused too.

/// Bytes a frame adds to its payload.
pub(crate) const FRAME_OVERHEAD: usize = 4 + 8 + FRAME_SUM;
/// Bytes sealing adds to a value.
pub(crate) const SEAL_LEN: usize = 8;
const FRAME_SUM: usize = 16;

/// Wraps `payload` into a frame.
pub(crate) fn frame(magic: [u8; 4], payload: &[u8]) -> Vec<u8> {
    let mut out = Vec::with_capacity(payload.len() + FRAME_OVERHEAD);
    out.extend_from_slice(&magic);
    out.extend_from_slice(&(payload.len() as u64).to_le_bytes());
    out.extend_from_slice(payload);
    let sum = blake3::hash(&out);
    out.extend(sum.as_bytes().iter().take(FRAME_SUM));
    out
}

/// The payload of a frame that fills `bytes` exactly, or what is wrong with it.
pub(crate) fn unframe(magic: [u8; 4], bytes: &[u8]) -> Result<&[u8], String> {
    let Some((body, sum)) = bytes.len().checked_sub(FRAME_SUM).and_then(|at| bytes.split_at_checked(at)) else {
        return Err(format!("{} bytes, too few for a frame", bytes.len()));
    };
    let hash = blake3::hash(body);
    if hash.as_bytes().get(..FRAME_SUM) != Some(sum) {
        return Err("a checksum that does not match".into());
    }
    let (Some(found), Some(length), Some(payload)) = (body.get(..4), body.get(4..12), body.get(12..)) else {
        return Err("a frame without a head".into());
    };
    if found != magic {
        return Err("a frame of another kind".into());
    }
    let length = length.iter().rev().fold(0u64, |sum, &byte| (sum << 8) | u64::from(byte));
    if length != payload.len() as u64 {
        return Err(format!("a length of {length} before {} bytes", payload.len()));
    }
    Ok(payload)
}

/// Adds to `payload` the checksum for its place, `tree` and `key`.
pub(crate) fn seal(tree: &str, key: &[u8], payload: &[u8]) -> Vec<u8> {
    let mut out = Vec::with_capacity(payload.len() + SEAL_LEN);
    out.extend_from_slice(payload);
    out.extend_from_slice(&seal_sum(tree, key, payload));
    out
}

/// The payload of a sealed value, or `None` if its checksum doesn't match.
pub(crate) fn unseal<'a>(tree: &str, key: &[u8], value: &'a [u8]) -> Option<&'a [u8]> {
    let (payload, sum) = value.split_at_checked(value.len().checked_sub(SEAL_LEN)?)?;
    (seal_sum(tree, key, payload) == sum).then_some(payload)
}

fn seal_sum(tree: &str, key: &[u8], payload: &[u8]) -> [u8; SEAL_LEN] {
    let mut hasher = blake3::Hasher::new();
    hasher.update(&(tree.len() as u64).to_le_bytes());
    hasher.update(tree.as_bytes());
    hasher.update(&(key.len() as u64).to_le_bytes());
    hasher.update(key);
    hasher.update(payload);
    let mut sum = [0; SEAL_LEN];
    hasher.finalize_xof().fill(&mut sum);
    sum
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_flipped_byte_of_a_frame_is_noticed() {
        let whole = frame(*b"TEST", b"some payload");
        assert_eq!(unframe(*b"TEST", &whole), Ok(&b"some payload"[..]));
        assert!(unframe(*b"ELSE", &whole).is_err());
        for at in 0..whole.len() {
            let mut bad = whole.clone();
            bad[at] ^= 0x10;
            assert!(unframe(*b"TEST", &bad).is_err(), "byte {at}");
            assert!(unframe(*b"TEST", &whole[..at]).is_err(), "cut at {at}");
        }
    }

    #[test]
    fn a_sealed_value_is_refused_under_another_key_or_tree() {
        let value = seal("parts", b"key", b"value");
        assert_eq!(unseal("parts", b"key", &value), Some(&b"value"[..]));
        assert_eq!(unseal("parts", b"kez", &value), None);
        assert_eq!(unseal("other", b"key", &value), None);
        assert_eq!(unseal("parts", b"key", &value[1..]), None);
        assert_eq!(unseal("parts", b"key", b""), None);
    }
}
