//! Files and bundles at the broker: objects that are named by their hashes.
//!
//! Invariant: what was loaded has the hash that it was asked for; its length is bounded by what was expected.

use std::fs::File;
use std::io::Write;
use std::path::Path;
use std::time::Duration;

use async_nats::jetstream::object_store::ObjectStore;
use base64::Engine;
use base64::engine::general_purpose::URL_SAFE;
use retrace_config::NumberedError;
use retrace_journal::{Timestamp, state_file};
use serde::Deserialize;

use super::broker_connection::{ANSWER_LIMIT, BrokerConnection, TRANSFER_LIMIT};
use super::stores::PROGRAMS;
use crate::bundle::{Bundle, MAX_JSON_BYTES, open_plain};
use crate::content_hash::ContentHash;
use crate::machine_folder::unusable;

/// Age from which a file is sent again for another job. It is kept at the broker for twice as long as a job, so that no
/// job outlives its files.
const RENEWED_AFTER: Duration = Duration::from_secs(20 * 86_400);

/// The programs at the broker.
pub(crate) struct ProgramStore<'a> {
    connection: &'a BrokerConnection,
    objects: ObjectStore,
}

fn object_name(hash: ContentHash) -> String {
    format!("sha256-{hash}")
}

impl<'a> ProgramStore<'a> {
    pub(crate) fn open(connection: &'a BrokerConnection) -> Result<Self, NumberedError> {
        Ok(Self { connection, objects: connection.objects(PROGRAMS)? })
    }

    /// Sends a bundle and its files, which lie in a folder under their hashes. What is there already is not sent again.
    ///
    /// # Errors
    /// `E5006` where a file cannot be had; `E5035`, `E5038`.
    pub(crate) fn send(&self, bundle: &Bundle, files: &Path) -> Result<(), NumberedError> {
        for file in bundle.files() {
            let plain = open_plain(&files.join(file.sha256.to_string()))?;
            self.send_one(file.sha256, file.bytes, tokio_file(plain))?;
        }
        let json = bundle.json();
        self.send_one(bundle.hash(), json.len() as u64, std::io::Cursor::new(json.into_bytes()))
    }

    fn send_one(
        &self,
        hash: ContentHash,
        bytes: u64,
        mut from: impl tokio::io::AsyncRead + Unpin,
    ) -> Result<(), NumberedError> {
        let name = object_name(hash);
        let known = self.connection.try_run(ANSWER_LIMIT, self.objects.info(&name));
        if let Some(Ok(info)) = known {
            let now_s = Timestamp::now().ms() / 1000;
            let age_s = info.modified.map(|when| now_s.saturating_sub(when.unix_timestamp().max(0).unsigned_abs()));
            let is_new = age_s.is_some_and(|age_s| age_s < RENEWED_AFTER.as_secs());
            if info.size as u64 == bytes && !info.deleted && is_new {
                return Ok(());
            }
        }
        let sent = self.objects.put(name.as_str(), &mut from);
        self.connection.run(TRANSFER_LIMIT, "a file that is sent", sent).map(|_| ())
    }

    /// Loads the bundle of this hash; `None` where the broker does not have it.
    ///
    /// # Errors
    /// `E5006`, `E5007` where it is not a bundle that may be stored; `E5035`, `E5038`.
    pub(crate) fn bundle(&self, hash: ContentHash) -> Result<Option<Bundle>, NumberedError> {
        let mut text = Vec::new();
        let limit = MAX_JSON_BYTES;
        match self.load(hash, limit, |part| {
            text.extend_from_slice(part);
            Ok(())
        })? {
            None => Ok(None),
            Some(bytes) if bytes > limit => Err(Bundle::too_large()),
            Some(_) => Bundle::parse(&text, hash).map(Some),
        }
    }

    /// Loads every file of a bundle to a folder, each under its hash, verified and durable. Returns whether the broker
    /// has all of them.
    ///
    /// # Errors
    /// `E5006` where one has another hash or length; `E5010`, `E5035`, `E5038`.
    pub(crate) fn load_files(&self, bundle: &Bundle, folder: &Path) -> Result<bool, NumberedError> {
        for file in bundle.files() {
            let path = folder.join(file.sha256.to_string());
            let failed = |error| unusable(&path, &error);
            let mut target =
                state_file::private().write(true).create(true).truncate(true).open(&path).map_err(failed)?;
            let loaded = self.load(file.sha256, file.bytes, |part| target.write_all(part).map_err(failed))?;
            let Some(_) = loaded else { return Ok(false) };
            target.sync_all().map_err(failed)?;
        }
        bundle.verify_hashes(folder)?;
        Ok(true)
    }

    /// Loads an object part by part, up to the first part beyond `limit`. Returns its length; `None` where it is not
    /// there.
    ///
    /// The parts are asked for one by one, in the layout of NATS object stores. The client's own way makes a consumer,
    /// and whoever may make one can have the server send what is stored to any subject.
    fn load(
        &self,
        hash: ContentHash,
        limit: u64,
        mut take: impl FnMut(&[u8]) -> Result<(), NumberedError>,
    ) -> Result<Option<u64>, NumberedError> {
        let stream = self.connection.stream(&format!("OBJ_{PROGRAMS}"))?;
        let subject = format!("$O.{PROGRAMS}.M.{}", URL_SAFE.encode(object_name(hash)));
        let request = stream.direct_get_builder().last_by_subject(subject).send();
        let Some(info) = self.connection.run_found("a file", request)? else { return Ok(None) };
        let info: ObjectInfo = serde_json::from_slice(&info.payload).unwrap_or_default();
        let is_name = !info.nuid.is_empty() && info.nuid.bytes().all(|byte| byte.is_ascii_alphanumeric());
        if info.deleted || !is_name {
            return Ok(None);
        }
        let subject = format!("$O.{PROGRAMS}.C.{}", info.nuid);
        let (mut next, mut bytes) = (1, 0_u64);
        for _ in 0..info.chunks {
            let request = stream.direct_get_builder().sequence(next).next_by_subject(subject.clone()).send();
            let Some(part) = self.connection.run_found("a part of a file", request)? else { return Ok(None) };
            next = part.sequence + 1;
            bytes += part.payload.len() as u64;
            if bytes > limit {
                return Ok(Some(bytes));
            }
            take(&part.payload)?;
        }
        Ok(Some(bytes))
    }
}

/// What is stored of an object beside its parts.
#[derive(Default, Deserialize)]
struct ObjectInfo {
    /// Name of its parts.
    nuid: String,
    /// Number of its parts.
    chunks: u64,
    #[serde(default)]
    deleted: bool,
}

/// Reads a file in the thread that waits for the transfer.
fn tokio_file(file: File) -> impl tokio::io::AsyncRead + Unpin {
    BlockingFile(file)
}

struct BlockingFile(File);

impl tokio::io::AsyncRead for BlockingFile {
    fn poll_read(
        mut self: std::pin::Pin<&mut Self>,
        _: &mut std::task::Context<'_>,
        to: &mut tokio::io::ReadBuf<'_>,
    ) -> std::task::Poll<std::io::Result<()>> {
        use std::io::Read;
        let read = self.0.read(to.initialize_unfilled())?;
        to.advance(read);
        std::task::Poll::Ready(Ok(()))
    }
}
