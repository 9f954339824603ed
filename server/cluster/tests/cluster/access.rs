//! Who gets in to the engine: TLS by an authority of one's own, certificates of servers, users and passwords. Left out where
//! there is no `nats-server` or no `openssl`.

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::Arc;
use std::time::Duration;

use crate::nodes::Nodes;
use quadmuse_cluster::{Access, ClusterOptions, EngineError, JetStream, SharedCorpus, SharedOptions};
use quadmuse_store::Backend;

fn openssl(dir: &Path, words: &str) {
    let run = Command::new("openssl").args(words.split(' ')).current_dir(dir).stdin(Stdio::null()).output();
    let run = run.expect("openssl runs");
    assert!(run.status.success(), "openssl {words}: {}", String::from_utf8_lossy(&run.stderr));
}

/// An authority, and a certificate and a key of it for whoever is at 127.0.0.1.
fn authority(dir: &Path, name: &str) {
    let ec = "-newkey ec -pkeyopt ec_paramgen_curve:prime256v1 -nodes";
    openssl(dir, &format!("req -x509 {ec} -keyout {name}-ca.key -out {name}-ca.pem -days 2 -subj /CN={name}"));
    openssl(dir, &format!("req {ec} -keyout {name}.key -out {name}.csr -subj /CN=127.0.0.1"));
    std::fs::write(dir.join("names"), "subjectAltName=IP:127.0.0.1\n").expect("written");
    let signed = format!("-CA {name}-ca.pem -CAkey {name}-ca.key -CAcreateserial -days 2 -extfile names");
    openssl(dir, &format!("x509 -req -in {name}.csr {signed} -out {name}.pem"));
}

#[test]
fn only_who_has_the_certificates_and_the_password_gets_in_and_only_to_whom_it_trusts() {
    let has_openssl = Command::new("openssl").arg("version").stdout(Stdio::null()).status().is_ok();
    if crate::nodes::program().is_none() || !has_openssl {
        eprintln!("left out: there is no nats-server, or no openssl");
        return;
    }
    let dir = tempfile::tempdir().expect("a directory");
    let path = |name: &str| -> PathBuf { dir.path().join(name) };
    authority(dir.path(), "studio");
    authority(dir.path(), "other");
    let tls = format!(
        "tls {{ cert_file: \"{}\", key_file: \"{}\", ca_file: \"{}\", verify: true }}\n\
         authorization {{ users: [{{ user: quadmuse, password: \"a secret\" }}] }}\n",
        path("studio.pem").display(),
        path("studio.key").display(),
        path("studio-ca.pem").display()
    );
    let nodes = Nodes::start_configured(1, "1GB", &tls).expect("there is an engine");
    let sound = Access {
        authorities: Some(path("studio-ca.pem")),
        certificate: Some((path("studio.pem"), path("studio.key"))),
        ..Access::default()
    };
    let reached = |user: &str, access: &Access| -> Result<JetStream, EngineError> {
        let address = nodes.addresses().replace("nats://", &format!("nats://{user}"));
        let options = ClusterOptions::new(&address, "studio");
        JetStream::connect(&ClusterOptions { access: access.clone(), reach: Duration::from_millis(500), ..options })
    };
    let right = "quadmuse:a%20secret@";
    let join = |cache: &str| {
        let engine = reached(right, &sound).expect("reached");
        SharedCorpus::open(Arc::new(engine), &SharedOptions::caching_in(&path(cache))).expect("joined")
    };
    let sample = crate::sample::Sample::with(1, vec![crate::sample::segment_of(1, &[32], 4)]);
    let id = join("one").add(&sample.example(), &[]).expect("added").record().id;
    assert_eq!(join("two").mesh_bytes(id).expect("there"), sample.mesh);

    let refused = |user: &str, access: &Access| reached(user, access).map(drop).expect_err("nobody gets in");
    for user in ["", "quadmuse:wrong@", "somebody:a%20secret@"] {
        refused(user, &sound);
    }
    // The engine's certificate is not of the authority that the server trusts.
    refused(right, &Access { authorities: Some(path("other-ca.pem")), ..sound.clone() });
    // The server's is not of the authority that the engine trusts, or there is none.
    refused(right, &Access { certificate: Some((path("other.pem"), path("other.key"))), ..sound.clone() });
    refused(right, &Access { certificate: None, ..sound.clone() });
    // Nor without TLS, and not to an authority of nobody's.
    refused(right, &Access::default());
    // What was right before is right still.
    reached(right, &sound).expect("reached");
}
