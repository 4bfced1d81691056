//! The connections of the service to the systems of a plant: office server, MQTT broker and OPC UA clients.

pub use super::archive::{run as run_archive, run_fleet};
use super::fault::Fault;
use super::load::CellFiles;
use panelprep_service::daemon::{
    InterfaceContext, OfficeParts, OfficeSender, OpcUaParts, OpcUaServer, SparkplugEdge, SparkplugParts,
};

pub use panelprep_service::daemon::OfficeStatus;

/// The plant connections; dropping them closes the connections.
pub struct PlantConnections {
    _office: Option<OfficeSender>,
    _sparkplug: Option<SparkplugEdge>,
    _opcua: Option<OpcUaServer>,
}

/// Connects the cell to each system that the cell file names.
///
/// # Errors
/// If a connection cannot be started.
pub fn connect(
    files: &CellFiles,
    context: &InterfaceContext,
    status: &OfficeStatus,
) -> Result<PlantConnections, Fault> {
    Ok(PlantConnections {
        _office: office_sender(files, context, status)?,
        _sparkplug: edge_node(files, context)?,
        _opcua: opcua_server(files, context)?,
    })
}

/// Starts to send records to the office server, if the cell file names a broker.
///
/// # Errors
/// If the sender cannot be started.
fn office_sender(
    files: &CellFiles,
    context: &InterfaceContext,
    status: &OfficeStatus,
) -> Result<Option<OfficeSender>, Fault> {
    let Some(office) = files.cell.office().cloned() else { return Ok(None) };
    let folder = files.store_folder().to_owned();
    let parts = OfficeParts { office, folder, front: Some(context.clone()), status: status.clone() };
    OfficeSender::start(parts).map(Some).map_err(Fault::stage)
}

/// Connects the cell to its MQTT broker, if the cell file names one.
///
/// # Errors
/// If the connection cannot be started.
fn edge_node(files: &CellFiles, context: &InterfaceContext) -> Result<Option<SparkplugEdge>, Fault> {
    let Some(node) = files.cell.sparkplug().cloned() else { return Ok(None) };
    tracing::info!("MQTT Sparkplug: edge node {} of the group {}", node.edge_node_id, node.group_id);
    SparkplugEdge::serve(SparkplugParts { node, front: context.clone() }).map(Some).map_err(Fault::stage)
}

/// Starts the OPC UA server of the cell, if the cell file names an address for it.
///
/// # Errors
/// If the operating system does not permit the address or cannot start a thread.
fn opcua_server(files: &CellFiles, context: &InterfaceContext) -> Result<Option<OpcUaServer>, Fault> {
    let parts = OpcUaParts { settings: files.cell.opcua().clone(), front: context.clone() };
    OpcUaServer::serve(parts).map_err(Fault::stage)
}
