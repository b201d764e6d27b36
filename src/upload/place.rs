//! Where a recording goes: the ropeway and the rope of these names, found at the service or created there.

use super::client::{Client, ClientError};
use super::plan::Plan;
use super::upload_error::UploadError;
use serde_json::{Value, json};
use uuid::Uuid;

/// The ropeway of this name: found, or created under the id derived from the name.
pub async fn ropeway(client: &Client, plan: &Plan) -> Result<Uuid, UploadError> {
    if let Some(found) = find(client, "/ropeways?limit=200", &plan.ropeway).await? {
        return Ok(id_of(&found)?);
    }
    let id = plan.ropeway_id();
    client.put(&format!("/ropeways/{id}"), &json!({"name": plan.ropeway})).await?;
    Ok(id)
}

/// The rope of this name: found and compared, or created.
pub async fn rope(client: &Client, plan: &Plan, ropeway_id: Uuid) -> Result<Uuid, UploadError> {
    let Some(found) = find(client, &format!("/ropes?limit=200&ropeway_id={ropeway_id}"), &plan.rope).await? else {
        let id = plan.rope_id(ropeway_id);
        let body = json!({"ropeway_id": ropeway_id, "name": plan.rope, "design": plan.design});
        client.put(&format!("/ropes/{id}"), &body).await?;
        return Ok(id);
    };
    for quantity in ["strands", "wires_per_strand", "rope_diameter_mm"] {
        let (held, ours) = (&found["design"][quantity], &plan.design[quantity]);
        if held.as_f64() != ours.as_f64() {
            return Err(UploadError::OtherDesign {
                ropeway: plan.ropeway.clone(),
                rope: plan.rope.clone(),
                quantity,
                held: held.clone(),
                ours: ours.clone(),
            });
        }
    }
    Ok(id_of(&found)?)
}

/// Looks through a list, page by page, for an item of this name.
async fn find(client: &Client, list: &str, name: &str) -> Result<Option<Value>, ClientError> {
    let mut path = list.to_owned();
    loop {
        let page = client.get(&path).await?;
        let items = page["items"].as_array().map(Vec::as_slice).unwrap_or_default();
        if let Some(item) = items.iter().find(|item| item["name"] == name) {
            return Ok(Some(item.clone()));
        }
        match page["next_cursor"].as_str() {
            Some(cursor) => path = format!("{list}&cursor={cursor}"),
            None => return Ok(None),
        }
    }
}

fn id_of(item: &Value) -> Result<Uuid, ClientError> {
    let text = item["id"].as_str().unwrap_or_default();
    text.parse().map_err(|_| ClientError::Answer {
        what: "GET of a list".into(),
        reason: format!("an item has the id {text:?}, which is no UUID"),
    })
}
