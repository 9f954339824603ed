//! Access fails closed, whatever becomes of the files; and no change is lost beside another.

use super::*;
use quadmuse_store::Document;

fn of_role(role: Role, name: &str) -> NewToken {
    NewToken { name: name.into(), role, ..NewToken::default() }
}

fn with_one() -> (tempfile::TempDir, Tokens, String, TokenRecord) {
    let dir = tempfile::tempdir().expect("a directory");
    let tokens = Tokens::beside(dir.path());
    let (secret, record) = tokens.create(&of_role(Role::Contributor, "ada")).expect("created");
    (dir, tokens, secret, record)
}

#[test]
fn a_token_is_found_until_it_is_revoked_and_never_stored() {
    let dir = tempfile::tempdir().expect("a directory");
    assert_eq!(Tokens::beside(dir.path()).access(), Access::Open);
    let (dir, tokens, secret, record) = with_one();
    assert_eq!(Tokens::beside(dir.path()).find(&secret), Some(record.clone()));
    assert_eq!(tokens.find(&secret), Some(record.clone()), "the one that created it sees it at once");
    assert_eq!(tokens.find("qm_other"), None);
    let file = std::fs::read_to_string(dir.path().join("tokens.json")).expect("a file");
    assert!(!file.contains(&secret[3..]));
    tokens.revoke(&record.id.to_string()).expect("revoked");
    assert_eq!(tokens.find(&secret), None);
    assert!(matches!(tokens.revoke("nobody"), Err(AuthError::Unknown(_))));
}

#[test]
fn once_a_token_existed_no_loss_of_the_list_opens_the_service() {
    type Break = fn(&Path);
    let broken: [(&str, Break); 5] = [
        ("removed", |list| std::fs::remove_file(list).expect("removed")),
        ("emptied", |list| std::fs::write(list, "").expect("written")),
        ("without a token", |list| std::fs::write(list, "[]").expect("written")),
        ("damaged", |list| std::fs::write(list, "[{\"id\": 7").expect("written")),
        ("a directory", |list| {
            std::fs::remove_file(list).expect("removed");
            std::fs::create_dir(list).expect("made");
        }),
    ];
    for (how, damage) in broken {
        let (dir, running, secret, record) = with_one();
        assert_eq!(running.find(&secret), Some(record));
        damage(&dir.path().join("tokens.json"));
        running.look_again();
        for tokens in [running, Tokens::beside(dir.path())] {
            assert_eq!(tokens.access(), Access::Tokens, "{how}");
            assert_eq!(tokens.find(&secret), None, "{how}");
        }
    }
}

#[test]
fn revoking_the_last_token_lets_in_nobody() {
    let (dir, running, secret, record) = with_one();
    Tokens::beside(dir.path()).revoke(&record.id.to_string()).expect("revoked");
    running.look_again();
    assert_eq!((running.access(), running.find(&secret)), (Access::Tokens, None));
    assert_eq!(Tokens::beside(dir.path()).access(), Access::Tokens);
}

#[test]
fn a_list_of_an_older_release_is_read_and_leaves_the_mark() {
    let dir = tempfile::tempdir().expect("a directory");
    let list = format!(
        r#"[{{"id": "{}", "name": "old", "role": "admin", "hash": "{}"}}]"#,
        TokenId::generate(),
        hash_of("qm_old")
    );
    std::fs::write(dir.path().join("tokens.json"), list).expect("written");
    assert_eq!(Tokens::beside(dir.path()).find("qm_old").map(|record| record.role), Some(Role::Admin));
    std::fs::remove_file(dir.path().join("tokens.json")).expect("removed");
    assert_eq!(Tokens::beside(dir.path()).access(), Access::Tokens);
}

#[test]
fn a_damaged_list_is_not_written_over() {
    let (dir, tokens, _, _) = with_one();
    std::fs::write(dir.path().join("tokens.json"), "damaged").expect("written");
    assert!(matches!(tokens.create(&of_role(Role::Admin, "eve")), Err(AuthError::Format { .. })));
    assert_eq!(std::fs::read(dir.path().join("tokens.json")).expect("a file"), b"damaged");
}

#[test]
fn no_revocation_is_lost_beside_a_create() {
    let dir = tempfile::tempdir().expect("a directory");
    let path = dir.path().to_owned();
    let first = Tokens::beside(&path);
    let doomed: Vec<String> =
        (0..40).map(|_| first.create(&NewToken::default()).expect("created").1.id.to_string()).collect();
    let doomed = Arc::new(doomed);
    std::thread::scope(|scope| {
        for part in doomed.chunks(20) {
            let path = &path;
            // Each with a handle of its own, as processes have.
            scope.spawn(move || part.iter().for_each(|id| Tokens::beside(path).revoke(id).expect("revoked")));
            scope.spawn(move || {
                (0..20).for_each(|_| drop(Tokens::beside(path).create(&NewToken::default()).expect("created")));
            });
        }
    });
    let left = first.list().expect("a list");
    assert_eq!(left.len(), 40);
    assert!(left.iter().all(|record| !doomed.contains(&record.id.to_string())));
}

#[test]
fn a_token_expires_and_tells_when_it_was_used() {
    let dir = tempfile::tempdir().expect("a directory");
    let tokens = Tokens::beside(dir.path());
    let new = NewToken { expires_in_s: Some(3600), ..of_role(Role::Reader, "guest") };
    let (secret, record) = tokens.create(&new).expect("created");
    assert!(record.is_valid_at(now_s()) && !record.is_valid_at(now_s() + 3601));
    assert_eq!(tokens.list().expect("a list")[0].last_used_s, None);
    assert!(tokens.find(&secret).is_some());
    tokens.note_uses().expect("noted");
    let used = tokens.list().expect("a list")[0].last_used_s.expect("used");
    assert!(now_s() - used < 60);
    let past = TokenRecord { expires_s: Some(1), ..record.clone() };
    std::fs::write(dir.path().join("tokens.json"), serde_json::to_vec(&[past]).expect("json")).expect("written");
    tokens.look_again();
    assert_eq!(tokens.find(&secret), None);
    assert!(tokens.create(&NewToken { expires_in_s: Some(0), ..NewToken::default() }).is_err());
}

#[test]
fn noting_uses_brings_no_revoked_token_back() {
    let (dir, tokens, secret, record) = with_one();
    assert!(tokens.find(&secret).is_some());
    Tokens::beside(dir.path()).revoke(&record.id.to_string()).expect("revoked");
    tokens.note_uses().expect("noted");
    assert_eq!(tokens.list().expect("a list"), []);
}

#[test]
fn names_are_free_of_what_would_garble_a_list() {
    let dir = tempfile::tempdir().expect("a directory");
    let tokens = Tokens::beside(dir.path());
    for name in ["a\nb", "\u{202e}nimda", &"x".repeat(201)] {
        assert!(matches!(tokens.create(&of_role(Role::Reader, name)), Err(AuthError::Invalid { .. })), "{name:?}");
    }
    assert_eq!(tokens.access(), Access::Open, "nothing was created");
}

#[test]
fn only_their_owner_may_read_the_files() {
    use std::os::unix::fs::PermissionsExt;
    let (dir, ..) = with_one();
    for file in ["tokens.json", "tokens.required", "tokens.lock"] {
        let mode = std::fs::metadata(dir.path().join(file)).expect(file).permissions().mode();
        assert_eq!(mode & 0o077, 0, "{file}");
    }
}

/// A document that servers share, without an engine.
#[derive(Default)]
struct OneDocument(Mutex<Option<Document>>);

impl Documents for OneDocument {
    fn known(&self, _: &str) -> Option<Document> {
        self.0.lock().expect("whole").clone()
    }

    fn read(&self, name: &str) -> Result<Option<Document>, StoreError> {
        Ok(self.known(name))
    }

    fn write(&self, _: &str, expected: u64, bytes: &[u8]) -> Result<bool, StoreError> {
        let mut document = self.0.lock().expect("whole");
        let revision = document.as_ref().map_or(0, |document| document.revision);
        if revision == expected {
            *document = Some(Document { revision: revision + 1, bytes: bytes.into() });
        }
        Ok(revision == expected)
    }
}

#[test]
fn tokens_of_servers_that_share_a_corpus_hold_on_all_of_them() {
    let document = Arc::new(OneDocument::default());
    let servers = [(); 2].map(|()| Tokens::shared(document.clone()));
    assert_eq!(servers[0].access(), Access::Open);
    // Made at once on both: none is lost.
    let secrets: Vec<String> = std::thread::scope(|scope| {
        let made = servers.each_ref().map(|server| {
            scope.spawn(|| (0..10).map(|_| server.create(&NewToken::default()).expect("created").0).collect::<Vec<_>>())
        });
        made.into_iter().flat_map(|made| made.join().expect("ended")).collect()
    });
    for server in &servers {
        server.look_again();
        assert_eq!((server.access(), server.list().expect("read").len()), (Access::Tokens, 20));
        assert!(secrets.iter().all(|secret| server.find(secret).is_some()));
    }
    let all = servers[0].list().expect("read");
    all.iter().for_each(|record| servers[1].revoke(&record.id.to_string()).expect("revoked"));
    servers[0].look_again();
    // An empty list lets in nobody, and neither does a damaged one.
    assert_eq!((servers[0].access(), servers[0].find(&secrets[0])), (Access::Tokens, None));
    *document.0.lock().expect("whole") = Some(Document { revision: 99, bytes: (*b"[{").into() });
    servers[0].look_again();
    assert_eq!((servers[0].access(), servers[0].find(&secrets[0])), (Access::Tokens, None));
}
