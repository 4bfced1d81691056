//! The connections of the service to people and other programs, as far as the cell's file names them: the operator's
//! page, the quality system, the systems of a plant and a production line.

use super::alarms::Alarms;
use super::gateway::{Gateway, InterfaceContext};
use super::line::{LineFront, LineParts};
use super::live_view::LiveView;
#[cfg(feature = "plant")]
use super::office::{OfficeParts, OfficeSender};
#[cfg(feature = "plant")]
use super::opcua::{OpcUaParts, OpcUaServer};
use super::people::AccountService;
use super::ports::LinkedRobot;
use super::push::{PushParts, PushSender};
#[cfg(feature = "plant")]
use super::sparkplug::{SparkplugEdge, SparkplugParts};
use super::transfer::RecordTransfers;
use super::web::{OperatorPage, PageError, PageParts};
use crate::setup::{CellFiles, SetupFault};
use std::sync::Arc;

/// The connections; they end when this is dropped.
pub struct Interfaces {
    _page: Option<OperatorPage>,
    _push: Option<PushSender>,
    #[cfg(feature = "plant")]
    _plant: PlantConnections,
    _line: Option<LineFront>,
}

impl Interfaces {
    /// Starts each connection that the cell's file names.
    ///
    /// # Errors
    /// If a connection cannot be started. If the certificate or the texts of the page are missing, there is no page,
    /// which raises an alarm.
    pub fn start(
        files: &Arc<CellFiles>,
        gateway: Gateway,
        robot: &LinkedRobot,
        view: LiveView,
    ) -> Result<Self, SetupFault> {
        let people = Arc::new(AccountService::new(files.store_folder().to_owned()));
        let alarms = Arc::new(Alarms::new(people.clone()));
        let transfers = RecordTransfers::default();
        let context = InterfaceContext { gateway, people, alarms, setup: files.clone(), transfers };
        Ok(Interfaces {
            _page: operator_page(&context, view)?,
            _push: push_sender(&context)?,
            #[cfg(feature = "plant")]
            _plant: PlantConnections::start(&context)?,
            _line: line_front(&context, robot)?,
        })
    }
}

/// Serves the operator's page, if the cell's file names an address for it.
fn operator_page(context: &InterfaceContext, view: LiveView) -> Result<Option<OperatorPage>, SetupFault> {
    let files = &context.setup;
    let (page, folder) = (files.cell.page().clone(), files.store_folder().to_owned());
    let page = match OperatorPage::serve(PageParts { page, folder, front: context.clone(), view }) {
        Ok(page) => page,
        // The cell can still be stopped and queried through its socket.
        Err(error @ PageError::File(_)) => {
            context.alarms.set_connection_problem("the operator's page", Some(&error.to_string()));
            tracing::warn!("{error}; the cell works without the operator's page until the service is restarted");
            None
        }
        Err(error) => return Err(SetupFault::stage(error)),
    };
    if let Some(page) = &page {
        tracing::info!("operator's page: {}", page.url);
        if let Some(fingerprint) = &page.fingerprint {
            tracing::info!("SHA-256 of the page's self-signed certificate: {fingerprint}");
        }
    }
    Ok(page)
}

/// Sends signed records to the quality system, if the cell's file names one.
fn push_sender(context: &InterfaceContext) -> Result<Option<PushSender>, SetupFault> {
    let Some(push) = context.setup.cell.push().cloned() else { return Ok(None) };
    tracing::info!("signed records are uploaded to URLs below {}", push.target_folder);
    let parts = PushParts { push, files: context.setup.clone(), status: context.transfers.push.clone() };
    PushSender::start(parts).map(Some).map_err(SetupFault::stage)
}

/// Watches the line through its digital signals, if the cell's file has a line.
fn line_front(context: &InterfaceContext, robot: &LinkedRobot) -> Result<Option<LineFront>, SetupFault> {
    let cell = &context.setup.cell;
    let (Some(line), Some(inputs)) = (cell.line().cloned(), LineParts::input_bits(cell.inputs_outputs())) else {
        return Ok(None);
    };
    tracing::info!("the line's signals request cycles with the recipe {}", line.recipe.display());
    let (last, outputs) = (robot.last_state(), robot.line());
    let (gateway, people) = (context.gateway.clone(), context.people.clone());
    LineFront::serve(LineParts { line, inputs, last, outputs, gateway, people })
        .map(Some)
        .map_err(SetupFault::stage)
}

/// The connections to the systems of a plant: the office, the MQTT broker and OPC UA clients.
#[cfg(feature = "plant")]
struct PlantConnections {
    _office: Option<OfficeSender>,
    _sparkplug: Option<SparkplugEdge>,
    _opcua: Option<OpcUaServer>,
}

#[cfg(feature = "plant")]
impl PlantConnections {
    /// Connects the cell to each system that its file names.
    fn start(context: &InterfaceContext) -> Result<Self, SetupFault> {
        let (cell, front) = (&context.setup.cell, || context.clone());
        let office = cell.office().cloned().map(|office| OfficeParts {
            office,
            folder: context.setup.store_folder().to_owned(),
            front: Some(front()),
            status: context.transfers.office.clone(),
        });
        let node = cell.sparkplug().cloned().map(|node| {
            tracing::info!("MQTT Sparkplug: edge node {} of the group {}", node.edge_node_id, node.group_id);
            SparkplugParts { node, front: front() }
        });
        let opcua = OpcUaParts { settings: cell.opcua().clone(), front: front() };
        Ok(PlantConnections {
            _office: office.map(OfficeSender::start).transpose().map_err(SetupFault::stage)?,
            _sparkplug: node.map(SparkplugEdge::serve).transpose().map_err(SetupFault::stage)?,
            _opcua: OpcUaServer::serve(opcua).map_err(SetupFault::stage)?,
        })
    }
}
