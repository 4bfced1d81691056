//! Mutations of the store.

use super::{Mutation, change};

const BLOBS_SOURCE_PATH: &str = "src/store/store/blobs.rs";
const COMMIT_SOURCE_PATH: &str = "src/store/store/commit.rs";
const CONTACTS_SOURCE_PATH: &str = "src/store/store/motions.rs";
const DISCS_SOURCE_PATH: &str = "src/store/store/motions.rs";
const FULLNESS_SOURCE_PATH: &str = "src/store/store/fullness.rs";
const HEAD_SOURCE_PATH: &str = "src/store/store/head.rs";
const JOURNAL_SOURCE_PATH: &str = "src/store/store/journal.rs";
const MOTIONS_SOURCE_PATH: &str = "src/store/store/motions.rs";
const RESTORES_SOURCE_PATH: &str = "src/store/store/restores.rs";
const SCHEMA_SOURCE_PATH: &str = "src/store/store/schema.rs";

pub(super) const ALL: [Mutation; 19] = [
    change(
        "the log of the database is not flushed at a commit",
        SCHEMA_SOURCE_PATH,
        r#"connection.pragma_update(None, "synchronous", "FULL")?;"#,
        r#"connection.pragma_update(None, "synchronous", "NORMAL")?;"#,
    ),
    change(
        "the head is not flushed before a commit",
        HEAD_SOURCE_PATH,
        "self.write(Head { position: at, next_position: Some(next), database: None })?;\n        self.file.sync_data()",
        "self.write(Head { at, next_position: Some(next_position), database: None })",
    ),
    change(
        "a file of the store is not flushed before it has its name",
        BLOBS_SOURCE_PATH,
        "file.write_all(bytes)?;\n    file.sync_all()",
        "file.write_all(bytes)",
    ),
    change(
        "the folder of the store's files is not flushed",
        BLOBS_SOURCE_PATH,
        r#"flush::flush_folder(&self.folder).map_err(file_error("flush", &self.folder))"#,
        "Ok(())",
    ),
    change(
        "a start leaves the log of a killed process as it is",
        "src/store/store/opening.rs",
        "flush::flush_after_kill(&path)?;\n        let head_read",
        "let head_read",
    ),
    change(
        "a file of the store is written under its name",
        BLOBS_SOURCE_PATH,
        "let part = self.part(&hash);",
        "let part = path.clone();",
    ),
    change(
        "the head does not say where the chain will be",
        COMMIT_SOURCE_PATH,
        "head.prepare(before, last).map_err(TransactionFailure::Head)?;",
        "",
    ),
    change(
        "the reserve is not given up on a full disk",
        COMMIT_SOURCE_PATH,
        "if self.reserve.release() {",
        "if self.fullness.take_dropped() == u64::MAX && self.reserve.release() {",
    ),
    change(
        "a picture for which the disk has no place ends the work",
        FULLNESS_SOURCE_PATH,
        "if source.kind() == ErrorKind::StorageFull => {",
        "if source.kind() == ErrorKind::NotFound => {",
    ),
    change(
        "a start does not write what the last process did not come to",
        JOURNAL_SOURCE_PATH,
        "self.write_missing_rows(&settled)?;",
        "",
    ),
    change(
        "a start leaves a cycle open whose end was not written",
        MOTIONS_SOURCE_PATH,
        "self.conclude(id, judgement.verdict, &judgement.reasons)?;",
        "tracing::warn!(?id, ?judgement);",
    ),
    change(
        "a start concludes a cycle as aborted, whatever the journal says",
        MOTIONS_SOURCE_PATH,
        "conclusion.map_or(Verdict::Aborted, |(_, verdict)| verdict)",
        "conclusion.map_or(Verdict::Aborted, |_| Verdict::Aborted)",
    ),
    change(
        "the first permit of a contact path is not written",
        CONTACTS_SOURCE_PATH,
        r#"            writing.execute(INSERT_PERMIT_SQL, params![id, unix_ms, permitted])?;
            writing.chain("permits", writing.last_insert_rowid())"#,
        "            let _ = (unix_ms, permitted);\n            Ok(())",
    ),
    change(
        "the end of a motion is kept without its waypoints",
        MOTIONS_SOURCE_PATH,
        "params![text, outcome, done]",
        "params![text, outcome, done.min(0)]",
    ),
    change(
        "the wear of the disc is not in the chain",
        DISCS_SOURCE_PATH,
        r#"writing.chain("discs", writing.last_insert_rowid())"#,
        "Ok(())",
    ),
    change(
        "a new disc continues from the wear of the old one",
        DISCS_SOURCE_PATH,
        "FROM discs WHERE is_new)",
        "FROM discs WHERE id < 0)",
    ),
    change(
        "a restored store asks no person",
        RESTORES_SOURCE_PATH,
        "self.append(&Event::Reported(Report::StoreRestored), None)?;",
        "",
    ),
    change(
        "after a restore numbers of cycles are used again",
        RESTORES_SOURCE_PATH,
        "own.max(replaced)",
        "own.min(replaced)",
    ),
    change(
        "after a restore a part counts from the backup",
        RESTORES_SOURCE_PATH,
        "self.unknown_pass_count(&start.panel, &serial)?.map_or(Ok(()), |lost| Err(StoreError::CountUnknown(lost)))",
        "Ok(())",
    ),
];
