//! The connections of the service to people and other programs: the operator's page, the office, the MQTT broker,
//! OPC UA clients and a line, with their shared parts.

use super::args::Common;
use super::fault::Fault;
use super::load::CellFiles;
use super::record_source::StoreRecords;
use super::setup_source::{FolderSource, RecordTransfers};
use panelprep_service::daemon::{
    AccountService, Alarms, Gateway, InterfaceContext, LineFront, LineParts, LinkedRobot, LiveView, OfficeParts,
    OfficeSender, OpcUaParts, OpcUaServer, OperatorPage, PageError, PageParts, PushParts, PushSender,
    SparkplugEdge, SparkplugParts,
};
use std::sync::Arc;

/// The parts that all interfaces share.
pub struct SharedInterfaceParts {
    parts: InterfaceContext,
    record_transfers: RecordTransfers,
}

impl SharedInterfaceParts {
    /// Creates the shared parts for a cell with these files.
    pub fn new((files, common): (&Arc<CellFiles>, &Common), gateway: Gateway) -> Self {
        let on_their_way = RecordTransfers::default();
        let people = Arc::new(AccountService::new(files.store_folder().to_owned()));
        let alarms = Arc::new(Alarms::new(people.clone()));
        let setup = Arc::new(FolderSource::new(files, common, &on_their_way));
        SharedInterfaceParts {
            parts: InterfaceContext { gateway, people, alarms, setup },
            record_transfers: on_their_way,
        }
    }
}

/// Sends records to the office, if the cell's file names a broker.
///
/// # Errors
/// If the sender cannot be started.
pub fn office_sender(files: &CellFiles, fronts: &SharedInterfaceParts) -> Result<Option<OfficeSender>, Fault> {
    let Some(office) = files.cell.office().cloned() else { return Ok(None) };
    let folder = files.store_folder().to_owned();
    let parts = OfficeParts {
        office,
        folder,
        front: Some(fronts.parts.clone()),
        status: fronts.record_transfers.office.clone(),
    };
    OfficeSender::start(parts).map(Some).map_err(Fault::stage)
}

/// Sends signed records to the quality system, if the cell's file names one.
///
/// # Errors
/// If the operating system refuses.
pub fn push_sender(files: &Arc<CellFiles>, fronts: &SharedInterfaceParts) -> Result<Option<PushSender>, Fault> {
    let Some(push) = files.cell.push().cloned() else { return Ok(None) };
    tracing::info!("signed records are uploaded to URLs below {}", push.target_folder);
    let (folder, records) = (files.store_folder().to_owned(), Arc::new(StoreRecords(files.clone())));
    let parts = PushParts { push, folder, records, status: fronts.record_transfers.push.clone() };
    PushSender::start(parts).map(Some).map_err(Fault::stage)
}

/// Connects the cell to its MQTT broker, if the cell's file names one.
///
/// # Errors
/// If it cannot be started.
pub fn edge_node(files: &CellFiles, fronts: &SharedInterfaceParts) -> Result<Option<SparkplugEdge>, Fault> {
    let Some(node) = files.cell.sparkplug().cloned() else { return Ok(None) };
    tracing::info!("MQTT Sparkplug: edge node {} of the group {}", node.edge_node_id, node.group_id);
    SparkplugEdge::serve(SparkplugParts { node, front: fronts.parts.clone() }).map(Some).map_err(Fault::stage)
}

/// Watches the line through its digital signals, if the cell's file has a line.
///
/// # Errors
/// If the operating system cannot start a thread.
pub fn line_front(
    files: &CellFiles,
    fronts: &SharedInterfaceParts,
    robot: &LinkedRobot,
) -> Result<Option<LineFront>, Fault> {
    let (Some(line), Some(inputs)) = (files.cell.line().cloned(), LineParts::bits(files.cell.inputs_outputs()))
    else {
        return Ok(None);
    };
    tracing::info!("the line's signals request cycles with the recipe {}", line.recipe.display());
    let (last, outputs) = (robot.last_state(), robot.line());
    let (gateway, people) = (fronts.parts.gateway.clone(), fronts.parts.people.clone());
    LineFront::serve(LineParts { line, inputs, last, outputs, gateway, people }).map(Some).map_err(Fault::stage)
}

/// Serves the cell by OPC UA, if its file names an address for it.
///
/// # Errors
/// If the operating system refuses.
pub fn opcua_server(files: &CellFiles, fronts: &SharedInterfaceParts) -> Result<Option<OpcUaServer>, Fault> {
    let parts = OpcUaParts { settings: files.cell.opcua().clone(), front: fronts.parts.clone() };
    OpcUaServer::serve(parts).map_err(Fault::stage)
}

/// Serves the operator's page, if the cell's file names an address for it.
///
/// # Errors
/// If the operating system refuses. If its certificate or its texts are missing, there is no page, which raises an
/// alarm.
pub fn operator_page(
    files: &Arc<CellFiles>,
    fronts: &SharedInterfaceParts,
    view: LiveView,
) -> Result<Option<OperatorPage>, Fault> {
    let parts = PageParts {
        page: files.cell.page().clone(),
        folder: files.store_folder().to_owned(),
        front: fronts.parts.clone(),
        view,
        records: Arc::new(StoreRecords(files.clone())),
    };
    let page = match OperatorPage::serve(parts) {
        Ok(page) => page,
        // The cell can still be stopped and queried through its socket.
        Err(error @ PageError::File(_)) => {
            fronts.parts.alarms.set_connection_problem("the operator's page", Some(&error.to_string()));
            tracing::warn!("{error}; the cell works without the operator's page until the service is restarted");
            None
        }
        Err(error) => return Err(Fault::stage(error)),
    };
    if let Some(page) = &page {
        tracing::info!("operator's page: {}", page.url);
        if let Some(fingerprint) = &page.fingerprint {
            tracing::info!("SHA-256 of the page's self-signed certificate: {fingerprint}");
        }
    }
    Ok(page)
}
