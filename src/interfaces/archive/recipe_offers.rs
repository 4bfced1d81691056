//! Recipes that the office offers to its cells.

use super::database;
use super::error::ArchiveError;
use crate::broker::OfficeLink;
use panelprep_store::office::{ArchiveSettings, RecipeOffer};
use tokio_postgres::Client;

/// Stores the offer, which replaces an earlier one for its panel, and sends it to the cells.
///
/// # Errors
/// If the database or the broker does not accept it.
pub async fn publish_offer(settings: &ArchiveSettings, offer: &RecipeOffer) -> Result<(), ArchiveError> {
    let client = database::open(&settings.database).await?;
    let link = OfficeLink::connect(&settings.broker, settings.max_waiting_bytes()).await?;
    let sql = "INSERT INTO offers (panel, recipe_hash, offer) VALUES ($1, $2, $3)
        ON CONFLICT (panel) DO UPDATE SET recipe_hash = EXCLUDED.recipe_hash, offer = EXCLUDED.offer";
    let bytes = offer.bytes().unwrap_or_default();
    let kept = client.execute(sql, &[&offer.panel, &offer.hash(), &bytes]).await;
    kept.map_err(ArchiveError::database("store an offer"))?;
    link.publish_offer(offer).await?;
    Ok(())
}

/// Sends every offer to the cells once more: the broker may have lost them.
pub(super) async fn republish_offers(client: &Client, link: &OfficeLink) -> Result<(), ArchiveError> {
    let rows =
        client.query("SELECT offer FROM offers", &[]).await.map_err(ArchiveError::database("read offers"))?;
    for row in rows {
        match RecipeOffer::read(&row.get::<_, Vec<u8>>(0)) {
            Ok(offer) => link.publish_offer(&offer).await?,
            Err(error) => tracing::error!("an offer in the database is not sent to the cells: {error}"),
        }
    }
    Ok(())
}
