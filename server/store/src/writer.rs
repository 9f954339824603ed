//! The one thread that writes: it commits what is waiting together, and mends the index after a failure.
//!
//! Order of a commit: objects' directory, rows and one sync of the index, ground files, their directory; only then the corpus in memory changes and
//! the callers are answered. Order of a removal: ground file, directory, rows, sync, answer, objects: killed in between, the example is
//! still whole in the index.

use std::collections::HashSet;
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender};
use std::sync::{Arc, PoisonError};
use std::time::{Duration, Instant};

use quadmuse_proto::id::ExampleId;

use crate::derived::Part;
use crate::engine::{Engine, Failure, Pointer};
use crate::error::StoreError;
use crate::files::{self, sync_dir};
use crate::index::Change;
use crate::keys::{Generation, SegmentKey};
use crate::record::{ContentHash, ExampleRecord, Patch};
use crate::recover::{Collect, OpenReport, open_index, reconcile};
use crate::shared::{Damaged, InFlight, Shared};
use crate::{Added, compact, spare};

/// Writes that may wait; more are refused as [`StoreError::Busy`].
pub(crate) const QUEUE_MAX: usize = 64;
/// Writes committed together.
const BATCH_MAX: usize = 32;
/// Up to so many files are synced one by one; more by one sync of the file system, which costs as some fifteen of them.
const SYNCED_SINGLY_MAX: usize = 8;
/// How often a suspended store looks whether it can go on.
const TICK: Duration = Duration::from_millis(250);
const REOPEN_EVERY: Duration = Duration::from_secs(1);
/// How long readers may hold on to an index that is to be closed.
const READERS_WAIT: Duration = Duration::from_secs(5);
/// How long an index may take to close.
const CLOSE_WAIT: Duration = Duration::from_secs(30);

/// The packed parts of one segment.
pub(crate) struct Packed {
    pub(crate) generation: Generation,
    pub(crate) pointer: Arc<Pointer>,
    pub(crate) parts: Vec<Part>,
}

impl Packed {
    pub(crate) fn new(encoder_version: u32, parts: Vec<Part>) -> Self {
        let generation = Generation::fresh();
        Self { generation, pointer: Arc::new(Pointer::new(encoder_version, generation, &parts)), parts }
    }
}

/// The rows of a new example.
pub(crate) struct NewRows {
    pub(crate) record: Arc<ExampleRecord>,
    pub(crate) segments: Vec<(u32, Packed)>,
    pub(crate) held: InFlight,
}

pub(crate) enum Work {
    Add(NewRows),
    /// Many at once; committed by themselves.
    AddAll(Vec<NewRows>),
    Annotate {
        id: ExampleId,
        patch: Patch,
    },
    Remove {
        id: ExampleId,
    },
    PutDerived {
        key: SegmentKey,
        packed: Packed,
    },
    Compact,
    Reopen,
}

pub(crate) enum Done {
    Added(Added),
    AddedAll(Vec<Added>),
    Annotated(Arc<ExampleRecord>),
    Unit,
}

pub(crate) struct Request {
    pub(crate) work: Work,
    pub(crate) reply: SyncSender<Result<Done, StoreError>>,
}

/// Why staging one request ended.
enum Stop {
    /// The request is refused; the others go on.
    Refused(StoreError),
    /// The index failed: none of this batch is known to be written.
    Failed(Failure),
}

impl From<StoreError> for Stop {
    fn from(error: StoreError) -> Self {
        Stop::Refused(error)
    }
}

impl From<Failure> for Stop {
    fn from(failure: Failure) -> Self {
        Stop::Failed(failure)
    }
}

/// What is left to do for a request once its rows are written.
#[derive(Default)]
struct Staged {
    changes: Vec<Change>,
    ground_put: Vec<Arc<ExampleRecord>>,
    after: Vec<After>,
    held: Vec<InFlight>,
}

/// A caller whose rows are written, or failed to be.
struct Waiting {
    reply: SyncSender<Result<Done, StoreError>>,
    removal: Option<ExampleId>,
    done: Option<Done>,
}

/// Tidying that an answer needn't wait for.
enum After {
    Settle(SegmentKey, Generation),
    Collect(SegmentKey, Generation),
    Bodies(ExampleId, Option<u32>),
    Ground(ExampleId, u32),
    Objects(Vec<ContentHash>),
}

pub(crate) struct Writer {
    pub(crate) shared: Arc<Shared>,
    pub(crate) requests: Receiver<Request>,
    pub(crate) tried: Instant,
}

impl Writer {
    /// Serves until every handle of the store is gone.
    pub(crate) fn run(mut self) {
        let mut carried = None;
        loop {
            let next = carried.take().map_or_else(|| self.requests.recv_timeout(TICK), Ok);
            match next {
                Ok(request) if self.shared.fault().is_some() => self.serve_suspended(request),
                Ok(Request { work: Work::Compact, reply }) => {
                    drop(reply.send(self.copy_index().and_then(|()| self.reopen_now())))
                }
                Ok(Request { work: Work::Reopen, reply }) => drop(reply.send(self.reopen_now())),
                Ok(many @ Request { work: Work::AddAll(_), .. }) => self.commit(vec![many]),
                Ok(first) => carried = self.serve(first),
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => {
                    // What was refused is not to come back with the next start, if the disk lets it be taken out.
                    if self.shared.fault().is_some() {
                        self.resume();
                    }
                    return;
                }
            }
            if self.shared.fault().is_some() && self.tried.elapsed() >= REOPEN_EVERY {
                self.resume();
                self.tried = Instant::now();
            }
        }
    }

    /// Commits `first` and what waits behind it, up to the first request that depends on one of them, which is returned.
    fn serve(&self, first: Request) -> Option<Request> {
        let mut touched = HashSet::new();
        self.touch(&first.work, &mut touched);
        let mut batch = vec![first];
        let mut carried = None;
        while batch.len() < BATCH_MAX
            && let Ok(request) = self.requests.try_recv()
        {
            if matches!(request.work, Work::Compact | Work::Reopen | Work::AddAll(_))
                || !self.touch(&request.work, &mut touched)
            {
                carried = Some(request);
                break;
            }
            batch.push(request);
        }
        self.commit(batch);
        carried
    }

    /// Notes which example a request is about; false if one before it in the batch is about the same.
    fn touch(&self, work: &Work, touched: &mut HashSet<[u8; 32]>) -> bool {
        let example = |id: ExampleId| {
            let identity = self.shared.index().record(id).map(|record| *record.identity.as_bytes());
            identity.unwrap_or_else(|| *ContentHash::of(&id.to_bytes()).as_bytes())
        };
        touched.insert(match work {
            Work::Add(rows) => *rows.record.identity.as_bytes(),
            Work::Annotate { id, .. } | Work::Remove { id } | Work::PutDerived { key: (id, _), .. } => example(*id),
            Work::Compact | Work::Reopen | Work::AddAll(_) => [0; 32],
        })
    }

    fn commit(&self, batch: Vec<Request>) {
        let mut staged = Vec::new();
        let mut waiting = Vec::new();
        let mut refused = Vec::new();
        let result = self.shared.engine().and_then(|engine| {
            for Request { work, reply } in batch {
                refused.extend(self.changed_by(&work));
                let removal = if let Work::Remove { id } = work { Some(id) } else { None };
                match self.stage(&engine, work) {
                    Ok((stage, done)) => {
                        staged.push(stage);
                        waiting.push(Waiting { reply, removal, done: Some(done) });
                    }
                    Err(Stop::Refused(error)) => drop(reply.send(Err(error))),
                    Err(Stop::Failed(failure)) => {
                        self.shared.failed(&failure);
                        waiting.push(Waiting { reply, removal, done: None });
                    }
                }
            }
            if self.shared.fault().is_some() {
                Err(self.shared.read_only())
            } else {
                self.make_durable(&engine, &staged).map(|()| engine)
            }
        });
        let Ok(engine) = result else {
            // What is answered as refused must not come back with the next opening of the index.
            self.shared.refused.lock().unwrap_or_else(PoisonError::into_inner).extend(refused);
            return waiting.into_iter().for_each(|waiting| self.answer_failed(waiting));
        };
        self.shared.publish(staged.iter_mut().flat_map(|stage| std::mem::take(&mut stage.changes)));
        for Waiting { reply, done, .. } in waiting {
            drop(reply.send(done.ok_or(StoreError::Closed)));
        }
        for after in staged.into_iter().flat_map(|stage| stage.after) {
            if let Err(stop) = self.tidy(&engine, after) {
                return self.note(&stop);
            }
        }
    }

    /// Answers a request of a batch that failed. A removal needs no index: it is done by files alone.
    fn answer_failed(&self, waiting: Waiting) {
        let result = waiting.removal.map_or_else(|| Err(self.shared.read_only()), |id| self.remove_files(id));
        drop(waiting.reply.send(result.map(|()| Done::Unit)));
    }

    fn note(&self, stop: &Stop) {
        match stop {
            Stop::Failed(failure) => self.shared.failed(failure),
            // A file that could not be removed is collected at the next opening.
            Stop::Refused(error) => tracing::warn!(%error, "could not tidy up"),
        }
    }

    /// Writes the rows of one request.
    fn stage(&self, engine: &Engine, work: Work) -> Result<(Staged, Done), Stop> {
        match work {
            Work::Add(rows) => {
                let mut stage = Staged::default();
                self.reserve(engine, std::slice::from_ref(&rows))?;
                let added = self.stage_add(engine, rows, &mut stage)?;
                Ok((stage, Done::Added(added)))
            }
            Work::AddAll(all) => {
                let mut stage = Staged::default();
                self.reserve(engine, &all)?;
                let added = all.into_iter().map(|rows| self.stage_add(engine, rows, &mut stage));
                let added = added.collect::<Result<_, _>>()?;
                Ok((stage, Done::AddedAll(added)))
            }
            Work::Annotate { id, patch } => self.stage_annotate(engine, id, &patch),
            Work::Remove { id } => self.stage_remove(engine, id),
            Work::PutDerived { key, packed } => self.stage_derived(engine, key, packed),
            Work::Compact | Work::Reopen => Ok((Staged::default(), Done::Unit)),
        }
    }

    /// Makes room for the encodings of the examples that aren't there yet.
    fn reserve(&self, engine: &Engine, all: &[NewRows]) -> Result<(), Failure> {
        let is_new = |rows: &&NewRows| self.shared.index().by_identity(rows.record.identity).is_none();
        let mut last = None;
        for rows in all.iter().filter(is_new) {
            for (number, packed) in &rows.segments {
                let key = (rows.record.id, *number);
                engine.reserve_parts(key, &packed.pointer)?;
                last = last.max(Some((key, packed.generation)));
            }
        }
        last.map_or(Ok(()), |last| engine.reserve_guards(last))
    }

    fn stage_add(&self, engine: &Engine, rows: NewRows, stage: &mut Staged) -> Result<Added, Stop> {
        let NewRows { record, segments, held } = rows;
        stage.held.push(held);
        let existing = self.shared.index().by_identity(record.identity).cloned();
        let existing = existing.or_else(|| stage.ground_put.iter().find(|r| r.identity == record.identity).cloned());
        if let Some(existing) = existing {
            // The caller has just written the objects anew where they were damaged; parts that another release found are not
            // among them.
            if let Some(labels) =
                existing.segmentation.labels().filter(|_| existing.segmentation != record.segmentation)
            {
                self.shared
                    .objects
                    .get(labels)?
                    .map_err(|reason| StoreError::Quarantined { id: existing.id, reason })?;
            }
            stage.changes.push(Change::Healed(existing.id));
            return Ok(Added::Exists(existing));
        }
        for (number, packed) in segments {
            let key = (record.id, number);
            engine.put_parts(key, packed.generation, &packed.parts)?;
            engine.put_pointer(key, &packed.pointer, None)?;
            stage.changes.push(Change::Pointer(key, packed.pointer));
            stage.after.push(After::Settle(key, packed.generation));
        }
        engine.put_record(&record, &files::encode(&record)?)?;
        stage.changes.push(Change::Record(record.clone()));
        stage.ground_put.push(record.clone());
        Ok(Added::Created(record))
    }

    fn stage_annotate(&self, engine: &Engine, id: ExampleId, patch: &Patch) -> Result<(Staged, Done), Stop> {
        let record = self.shared.index().record(id).cloned().ok_or(StoreError::NotFound { id })?;
        let next = Arc::new(patch.apply(&record)?);
        engine.put_record(&next, &files::encode(&next)?)?;
        let stage = Staged {
            changes: vec![Change::Record(next.clone())],
            ground_put: vec![next.clone()],
            after: vec![After::Ground(id, record.revision), After::Bodies(id, Some(next.revision))],
            ..Staged::default()
        };
        Ok((stage, Done::Annotated(next)))
    }

    fn stage_remove(&self, engine: &Engine, id: ExampleId) -> Result<(Staged, Done), Stop> {
        let (record, pointers) = self.known(id)?;
        if let Some(record) = &record {
            self.shared.ground.remove(id, record.revision)?;
            sync_dir(self.shared.ground.dir())?;
        }
        engine.remove_row(id)?;
        let mut stage = Staged { changes: vec![Change::Removed(id)], ..Staged::default() };
        for (key, pointer) in pointers {
            engine.remove_pointer(key, &pointer)?;
            stage.after.push(After::Collect(key, pointer.generation()));
        }
        stage.after.push(After::Bodies(id, None));
        if let Some(record) = record {
            stage.after.push(After::Objects(record.objects().collect()));
        }
        Ok((stage, Done::Unit))
    }

    /// The record (`None` if it is damaged) and the pointers of an example.
    fn known(
        &self,
        id: ExampleId,
    ) -> Result<(Option<Arc<ExampleRecord>>, Vec<(SegmentKey, Arc<Pointer>)>), StoreError> {
        let index = self.shared.index();
        let record = index.record(id).cloned();
        if record.is_none() && index.quarantine_reason(id).is_none() {
            return Err(StoreError::NotFound { id });
        }
        Ok((record, index.pointers_of(id).map(|(key, pointer)| (key, pointer.clone())).collect()))
    }

    fn stage_derived(&self, engine: &Engine, key: SegmentKey, packed: Packed) -> Result<(Staged, Done), Stop> {
        let former = {
            let index = self.shared.index();
            let record = index.record(key.0).ok_or(StoreError::NotFound { id: key.0 })?;
            crate::record::at_most(
                "the segment's number",
                "for this example",
                key.1 as usize + 1,
                record.segments.len(),
            )?;
            index.pointer(key).cloned()
        };
        engine.reserve_parts(key, &packed.pointer)?;
        engine.reserve_guards((key, packed.generation))?;
        engine.put_parts(key, packed.generation, &packed.parts)?;
        engine.put_pointer(key, &packed.pointer, former.as_deref())?;
        let mut after = vec![After::Settle(key, packed.generation)];
        after.extend(former.map(|former| After::Collect(key, former.generation())));
        Ok((Staged { changes: vec![Change::Pointer(key, packed.pointer)], after, ..Staged::default() }, Done::Unit))
    }

    /// Makes a batch durable; after an error here nothing is known of it.
    fn make_durable(&self, engine: &Engine, staged: &[Staged]) -> Result<(), StoreError> {
        let shared = &self.shared;
        let records: Vec<&ExampleRecord> =
            staged.iter().flat_map(|stage| stage.ground_put.iter().map(Arc::as_ref)).collect();
        let ground = || {
            match &records[..] {
                [] => return Ok(()),
                few if few.len() <= SYNCED_SINGLY_MAX => few.iter().try_for_each(|record| shared.ground.put(record))?,
                many => shared.ground.put_all(many)?,
            }
            sync_dir(shared.ground.dir())
        };
        let commit = || {
            engine.commit().map_err(|failure| {
                shared.failed(&failure);
                shared.read_only()
            })
        };
        let durable = sync_dir(shared.objects.dir()).and_then(|()| commit()).and_then(|()| ground());
        durable.inspect_err(|error| shared.suspend(&error.to_string(), Damaged::No))
    }

    fn tidy(&self, engine: &Engine, after: After) -> Result<(), Stop> {
        match after {
            After::Settle(key, generation) => engine.settle(key, generation)?,
            After::Collect(key, generation) => engine.collect(key, generation)?,
            After::Bodies(id, keep) => engine.remove_bodies(id, keep)?,
            After::Ground(id, revision) => self.shared.ground.remove(id, revision)?,
            After::Objects(objects) => objects.into_iter().try_for_each(|object| self.shared.remove_object(object))?,
        }
        Ok(())
    }

    /// While writing is suspended only removals go on: they need no space, and make some.
    fn serve_suspended(&self, request: Request) {
        let result = match request.work {
            Work::Remove { id } => self.remove_files(id).map(|()| Done::Unit),
            _ => Err(self.shared.read_only()),
        };
        drop(request.reply.send(result));
    }

    /// Removes an example by its files alone. Its row stays in the index until that is reopened: a row without ground file and
    /// objects is dropped then, so objects that another example needs stand in the way.
    fn remove_files(&self, id: ExampleId) -> Result<(), StoreError> {
        let (record, _) = self.known(id)?;
        let record = record.ok_or_else(|| self.shared.read_only())?;
        if self.shared.index().object_uses(record.content_hash) > 1 {
            return Err(self.shared.read_only());
        }
        self.shared.ground.remove(id, record.revision)?;
        sync_dir(self.shared.ground.dir())?;
        self.shared.objects.remove(record.content_hash)?;
        sync_dir(self.shared.objects.dir())?;
        self.shared.publish([Change::Removed(id)]);
        Ok(())
    }

    /// Tries to close and reopen a failed index.
    fn resume(&self) {
        let Some(fault) = self.shared.fault() else { return };
        if self.shared.options.available(&self.shared.dir) < fault.room {
            return;
        }
        if fault.damaged == Damaged::Index
            && let Err(error) = self.copy_index()
        {
            tracing::warn!(%error, "the damaged index can't be copied yet");
            return;
        }
        match self.reopen() {
            Ok(report) => {
                self.shared.clear_fault();
                spare::keep(&self.shared.dir, &self.shared.options);
                tracing::info!(?report, "the store writes again");
            }
            Err(error) => tracing::warn!(%error, "the index can't be reopened yet"),
        }
    }

    /// Copies what can be read of the index into a new one, and makes that the one to be opened next.
    fn copy_index(&self) -> Result<(), StoreError> {
        let engine = self.shared.engine()?;
        compact::copy(&self.shared, &engine)
    }

    fn reopen_now(&self) -> Result<Done, StoreError> {
        self.reopen().inspect_err(|error| self.shared.suspend(&error.to_string(), Damaged::No))?;
        Ok(Done::Unit)
    }

    /// The examples that a request would add or change, with the revisions that it would give them.
    fn changed_by(&self, work: &Work) -> Vec<(ExampleId, u32)> {
        let of = |rows: &NewRows| (rows.record.id, rows.record.revision);
        match work {
            Work::Add(rows) => vec![of(rows)],
            Work::AddAll(all) => all.iter().map(of).collect(),
            Work::Annotate { id, .. } => {
                self.shared.index().record(*id).map(|record| (*id, record.revision + 1)).into_iter().collect()
            }
            Work::Remove { .. } | Work::PutDerived { .. } | Work::Compact | Work::Reopen => Vec::new(),
        }
    }

    /// Takes out what was written of refused changes before the failure: rows of new examples go, those of others become what
    /// they were.
    fn forget_refused(&self, engine: &Engine) -> Result<(), StoreError> {
        let mut refused = self.shared.refused.lock().unwrap_or_else(PoisonError::into_inner);
        for &(id, revision) in refused.iter() {
            let failed = |failure: Failure| failure.into_error("remove a row");
            let kept = self.shared.index().record(id).cloned().filter(|kept| kept.revision < revision);
            match kept {
                Some(kept) => engine.put_record(&kept, &files::encode(&kept)?).map_err(failed)?,
                None => engine.remove_row(id).map_err(failed)?,
            }
            self.shared.ground.remove(id, revision)?;
        }
        refused.clear();
        Ok(())
    }

    /// Closes the index and opens it again; readers wait meanwhile.
    fn reopen(&self) -> Result<OpenReport, StoreError> {
        let shared = &self.shared;
        let mut slot = shared.engine.write().unwrap_or_else(PoisonError::into_inner);
        if let Some(engine) = slot.take()
            && let Err(engine) = close(engine)
        {
            *slot = Some(engine);
            return Err(StoreError::Busy);
        }
        compact::switch(&shared.dir)?;
        let mut report = OpenReport::default();
        let engine = open_index(&shared.dir, &shared.options, &mut report)?;
        self.forget_refused(&engine)?;
        let index = reconcile(&shared.dir, &engine, &shared.ground, &shared.objects, Collect::RowsOnly, &mut report)?;
        shared.replace_index(index);
        *slot = Some(Arc::new(engine));
        Ok(report)
    }
}

/// Closes an index as soon as no reader holds it; gives it back if one doesn't let go.
pub(crate) fn close(mut engine: Arc<Engine>) -> Result<(), Arc<Engine>> {
    let begun = Instant::now();
    let engine = loop {
        match Arc::try_unwrap(engine) {
            Ok(engine) => break engine,
            Err(shared) if begun.elapsed() > READERS_WAIT => return Err(shared),
            Err(shared) => engine = shared,
        }
        std::thread::sleep(Duration::from_millis(5));
    };
    // A failed database may panic or hang when it is dropped: on a thread of its own, it hurts nobody. It hangs most often in a write
    // that fails there, so what is left is written before; what that finds, dropping it would have found.
    let (sender, receiver) = std::sync::mpsc::sync_channel(1);
    let drop_it = move || {
        let _ = engine.commit();
        let dropped = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| drop(engine)));
        let _ = sender.send(dropped.is_ok());
    };
    if std::thread::Builder::new().name("store-close".into()).spawn(drop_it).is_ok() {
        let _ = receiver.recv_timeout(CLOSE_WAIT);
    }
    Ok(())
}
