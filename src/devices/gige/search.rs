//! Finds the cameras that answer, before one of them is selected.

/// A camera that answers.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FoundCamera {
    /// The identifier with which Aravis opens the camera.
    pub id: String,
    /// Its serial number.
    pub serial: String,
    /// Its IP address.
    pub address: String,
}

/// Searches every network interface of this machine for GigE Vision cameras.
///
/// # Errors
/// If no interface can be searched; the reason in words.
#[cfg(feature = "gige")]
pub fn search() -> Result<Vec<FoundCamera>, String> {
    use aravis::prelude::*;
    let interface = aravis::GvInterface::instance()
        .ok_or_else(|| "the Aravis library has no GigE Vision support".to_owned())?;
    interface.update_device_list();
    let text = |text: Option<aravis::glib::GString>| text.map_or(String::new(), String::from);
    let camera = |at| FoundCamera {
        id: text(interface.device_id(at)),
        serial: text(interface.device_serial_nbr(at)),
        address: text(interface.device_address(at)),
    };
    Ok((0..interface.n_devices()).map(camera).collect())
}

/// The search in a program that was built without the driver.
///
/// # Errors
/// Always, since this program was built without the driver.
#[cfg(not(feature = "gige"))]
pub fn search() -> Result<Vec<FoundCamera>, String> {
    Err("this program was built without the driver of GigE Vision cameras".to_owned())
}
