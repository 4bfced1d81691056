//! Taught panels, in versions that are named by the hash of their content and never changed.

use super::commit::{TransactionFailure, WriteTransaction};
use super::database::Store;
use super::error::StoreError;
use panelprep_base::config::nearest;
use panelprep_base::geometry::KukaPose;
use panelprep_cell::files::{content_hash, read_flange, write_pose};
use rusqlite::{Row, params};

pub(super) const TABLES: &str = "
    CREATE TABLE taught_panels (
        id INTEGER PRIMARY KEY,
        name TEXT NOT NULL,
        version TEXT NOT NULL,
        taught_at_unix_s INTEGER NOT NULL,
        scan_hash TEXT NOT NULL,
        recipe_text TEXT NOT NULL,
        scanner_calibration_text TEXT NOT NULL,
        base_from_camera_text TEXT NOT NULL,
        flange_camera_text TEXT NOT NULL,
        flange_from_camera_text TEXT NOT NULL
    ) STRICT;
    CREATE INDEX taught_panels_by_name ON taught_panels (name);
    CREATE TABLE taught_corners (
        panel_id INTEGER NOT NULL REFERENCES taught_panels (id),
        position INTEGER NOT NULL,
        picture_hash TEXT NOT NULL,
        base_from_flange TEXT NOT NULL,
        PRIMARY KEY (panel_id, position)
    ) STRICT;
";

/// All inputs with which a panel is taught: unchanged files and texts.
#[derive(Debug, Clone, PartialEq)]
pub struct TeachingInputs {
    /// The name of the panel, from the recipe.
    pub name: String,
    /// The scan of the panel at its nominal pose by the 3D camera, PCD.
    pub scan: Vec<u8>,
    /// The text of the recipe.
    pub recipe_text: String,
    /// The text of the file with the intrinsics of the 3D camera.
    pub scanner_calibration_text: String,
    /// The text of the file with the mount of the 3D camera.
    pub base_from_camera_text: String,
    /// The taught corners, in their order.
    pub corners: Vec<TaughtCorner>,
    /// The text of the file with the intrinsics of the flange camera.
    pub flange_camera_text: String,
    /// The text of the file with the mount of the flange camera.
    pub flange_from_camera_text: String,
}

/// A taught corner of the panel.
#[derive(Debug, Clone, PartialEq)]
pub struct TaughtCorner {
    /// The content of the corner picture's file.
    pub picture: Vec<u8>,
    /// The flange pose at which the picture was captured.
    pub base_from_flange: KukaPose,
}

/// A taught panel in the store.
#[derive(Debug, Clone, PartialEq)]
pub struct StoredTeaching {
    /// The version: the first 16 hexadecimal digits of the content's hash.
    pub version: String,
    /// Time of teaching, s since 1970.
    pub taught_at_unix_s: i64,
    /// The inputs with which the panel was taught.
    pub teaching: TeachingInputs,
}

/// The inputs of a taught panel as its row stores them: the hash of each file instead of its content.
struct Record {
    scan_hash: String,
    texts: [String; 5],
    /// For each corner the hash of the picture, and the flange pose as JSON, which is read back exactly.
    corners: Vec<(String, String)>,
}

impl Record {
    /// Returns the version: the first 16 digits of the hash of all inputs' hashes. These hashes have a fixed length, so
    /// that different inputs cannot give the same sequence of bytes.
    fn version(&self) -> String {
        let texts = self.texts.iter().map(|text| content_hash(text.as_bytes()));
        let corners = self.corners.iter().map(|(picture, pose)| format!("{picture} {}", pose.trim_end()));
        let lines: Vec<String> = std::iter::once(self.scan_hash.clone()).chain(texts).chain(corners).collect();
        content_hash(lines.join("\n").as_bytes())[..16].to_owned()
    }
}

impl Store {
    /// Stores the inputs as the newest version of a panel, and returns the version. Equal inputs have the same version.
    ///
    /// # Errors
    /// If the store is open for reading only, a flange pose is not finite, or a file or row cannot be written. The
    /// panel is then unchanged.
    pub fn teach(&mut self, teaching: &TeachingInputs) -> Result<String, StoreError> {
        if let Some(corner) = teaching.corners.iter().position(|corner| !corner.base_from_flange.is_finite()) {
            return Err(StoreError::Pose { corner: corner + 1 });
        }
        self.require_writable()?;
        let corner =
            |corner: &TaughtCorner| Ok((self.store_blob(&corner.picture)?, write_pose(&corner.base_from_flange)));
        let record = Record {
            scan_hash: self.store_blob(&teaching.scan)?,
            texts: [
                teaching.recipe_text.clone(),
                teaching.scanner_calibration_text.clone(),
                teaching.base_from_camera_text.clone(),
                teaching.flange_camera_text.clone(),
                teaching.flange_from_camera_text.clone(),
            ],
            corners: teaching.corners.iter().map(corner).collect::<Result<_, StoreError>>()?,
        };
        let version = record.version();
        let taught_at_unix_s = self.unix_s();
        self.commit("write", |writing| insert(writing, (&teaching.name, &version, taught_at_unix_s), &record))?;
        Ok(version)
    }

    /// Returns the inputs of a taught panel, in this version or in the newest one. The hash of every input is verified.
    ///
    /// # Errors
    /// If the panel or the version does not exist, or one of its inputs is damaged.
    pub fn taught(&self, name: &str, version: Option<&str>) -> Result<StoredTeaching, StoreError> {
        let found = self.record(name, version).map_err(|error| self.database_error("read", &error))?;
        let Some((stored_version, taught_at_unix_s, record)) = found else {
            return Err(self.unknown(name, version));
        };
        let damaged = |problem: String| StoreError::DamagedRow {
            name: name.to_owned(),
            version: stored_version.clone(),
            problem,
        };
        if record.version() != stored_version {
            return Err(damaged(format!("the content is that of version {}", record.version())));
        }
        let corner = |(picture_hash, pose): &(String, String)| {
            let base_from_flange = read_flange(pose.as_bytes()).map_err(|error| damaged(error.to_string()))?;
            Ok(TaughtCorner { picture: self.blob(picture_hash)?, base_from_flange })
        };
        let corners = record.corners.iter().map(corner).collect::<Result<_, StoreError>>()?;
        let scan = self.blob(&record.scan_hash)?;
        let [
            recipe_text,
            scanner_calibration_text,
            base_from_camera_text,
            flange_camera_text,
            flange_from_camera_text,
        ] = record.texts;
        let teaching = TeachingInputs {
            name: name.to_owned(),
            scan,
            recipe_text,
            scanner_calibration_text,
            base_from_camera_text,
            corners,
            flange_camera_text,
            flange_from_camera_text,
        };
        Ok(StoredTeaching { version: stored_version, taught_at_unix_s, teaching })
    }

    /// Returns the names of all taught panels, in alphabetical order.
    ///
    /// # Errors
    /// If the names cannot be read.
    pub fn panel_names(&self) -> Result<Vec<String>, StoreError> {
        self.names().map_err(|error| self.database_error("read", &error))
    }

    fn names(&self) -> Result<Vec<String>, rusqlite::Error> {
        let mut names = self.connection.prepare("SELECT DISTINCT name FROM taught_panels ORDER BY name")?;
        names.query_map([], |row| row.get(0))?.collect()
    }

    fn record(&self, name: &str, version: Option<&str>) -> Result<Option<(String, i64, Record)>, rusqlite::Error> {
        let mut panels = self.connection.prepare(
            "SELECT id, version, taught_at_unix_s, scan_hash, recipe_text, scanner_calibration_text,
                base_from_camera_text, flange_camera_text, flange_from_camera_text
             FROM taught_panels WHERE name = ?1 AND (?2 IS NULL OR version = ?2) ORDER BY id DESC LIMIT 1",
        )?;
        let panel = |row: &Row<'_>| -> Result<(i64, String, i64, Record), rusqlite::Error> {
            let texts = [row.get(4)?, row.get(5)?, row.get(6)?, row.get(7)?, row.get(8)?];
            let record = Record { scan_hash: row.get(3)?, texts, corners: Vec::new() };
            Ok((row.get(0)?, row.get(1)?, row.get(2)?, record))
        };
        let mut rows = panels.query_map(params![name, version], panel)?;
        let Some((id, version, taught_at_unix_s, mut record)) = rows.next().transpose()? else { return Ok(None) };
        let mut corners = self.connection.prepare(
            "SELECT picture_hash, base_from_flange FROM taught_corners WHERE panel_id = ?1 ORDER BY position",
        )?;
        record.corners =
            corners.query_map([id], |row| Ok((row.get(0)?, row.get(1)?)))?.collect::<Result<_, _>>()?;
        Ok(Some((version, taught_at_unix_s, record)))
    }

    fn unknown(&self, name: &str, version: Option<&str>) -> StoreError {
        let lists = || -> Result<(Vec<String>, Vec<String>), rusqlite::Error> {
            let names = self.names()?;
            let mut versions =
                self.connection.prepare("SELECT version FROM taught_panels WHERE name = ?1 ORDER BY id")?;
            let versions = versions.query_map([name], |row| row.get(0))?.collect::<Result<_, _>>()?;
            Ok((names, versions))
        };
        let (names, versions) = match lists() {
            Ok(lists) => lists,
            Err(error) => return self.database_error("read", &error),
        };
        match version {
            Some(version) if !versions.is_empty() => {
                StoreError::UnknownVersion { name: name.to_owned(), version: version.to_owned(), known: versions }
            }
            _ => {
                let known: Vec<&str> = names.iter().map(String::as_str).collect();
                let nearest = nearest(name, &known).map(|(name, _)| name.to_owned());
                StoreError::UnknownPanel { name: name.to_owned(), nearest, known: names }
            }
        }
    }
}

fn insert(
    writing: &mut WriteTransaction<'_>,
    (name, version, taught_at_unix_s): (&str, &str, i64),
    record: &Record,
) -> Result<(), TransactionFailure> {
    let [recipe, scanner, base_from_camera, flange_camera, flange_from_camera] = &record.texts;
    writing.execute(
        "INSERT INTO taught_panels (name, version, taught_at_unix_s, scan_hash, recipe_text,
            scanner_calibration_text, base_from_camera_text, flange_camera_text, flange_from_camera_text)
         VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?7, ?8, ?9)",
        params![
            name,
            version,
            taught_at_unix_s,
            record.scan_hash,
            recipe,
            scanner,
            base_from_camera,
            flange_camera,
            flange_from_camera
        ],
    )?;
    let panel_id = writing.last_insert_rowid();
    writing.chain("taught_panels", panel_id)?;
    for (position, (picture_hash, base_from_flange)) in record.corners.iter().enumerate() {
        let position = position as i64;
        writing.execute(
            "INSERT INTO taught_corners (panel_id, position, picture_hash, base_from_flange)
             VALUES (?1, ?2, ?3, ?4)",
            params![panel_id, position, picture_hash, base_from_flange],
        )?;
        writing.chain("taught_corners", panel_id * 65_536 + position)?;
    }
    Ok(())
}
