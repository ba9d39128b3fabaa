//! References in files: an EXR with `R G B` and `error.R error.G error.B`, and in its attributes what is needed to go on.

use std::path::Path;

use super::{Account, Estimate, Reference};
use crate::Error;
use crate::image::{ImageError, read_exr, read_exr_text, write_exr_with_text};

const FINGERPRINT: &str = "pinspot.fingerprint";
const ACCOUNT: &str = "pinspot.account";

impl Reference {
    /// Writes an estimate, whole or not at all.
    pub fn write(&self, path: &Path, estimate: &Estimate) -> Result<(), Error> {
        let account = serde_json::to_string(&estimate.account).expect("numbers are plain data");
        let layers = [("", &estimate.irradiance), ("error", &estimate.standard_error)];
        let texts = [(FINGERPRINT, self.fingerprint().to_owned()), (ACCOUNT, account)];
        Ok(write_exr_with_text(path, &layers, &texts)?)
    }

    /// Reads an estimate to go on with; `None` if there is no file or it holds anything else than an earlier state of this
    /// very reference.
    pub fn read(&self, path: &Path) -> Result<Option<Estimate>, Error> {
        if !path.exists() {
            return Ok(None);
        }
        let text = |name| read_exr_text(path, name);
        let Ok(Some(fingerprint)) = text(FINGERPRINT) else { return Ok(None) };
        if fingerprint != self.fingerprint() {
            return Ok(None);
        }
        let damaged = || ImageError::Read { path: path.into(), reason: "its account is damaged; delete it".into() };
        let account = text(ACCOUNT)?.ok_or_else(damaged)?;
        let account: Account = serde_json::from_str(&account).map_err(|_| damaged())?;
        Ok(Some(Estimate { irradiance: read_exr(path, "")?, standard_error: read_exr(path, "error")?, account }))
    }
}
