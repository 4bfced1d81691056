//! Tests the drawing of a recipe's region on the page, and the other views of the set-up.

use super::{DOOR, PASSWORD, PageFixture};
use axum::http::StatusCode;
use panelprep_cell::files::content_hash;
#[cfg(feature = "plant")]
use panelprep_store::office::RecipeOffer;
use serde_json::{Value, json};

fn drawn() -> Value {
    json!({
        "corners_px": [[12, 10], [90, 10], [90, 60], [10, 60]], "rows": 2, "columns": 3,
        "masked_px": [[[20, 20], [30, 20], [30, 30], [20, 30]]], "outline_px": [], "held_px": [],
    })
}

/// The drawing becomes lines of the recipe. The recipe is saved with the same form as every other change, with its
/// reason.
#[tokio::test]
async fn a_drawing_is_proposed_and_not_yet_written() {
    let site = PageFixture::new();
    let engineer = site.log_in("engineer", PASSWORD).await.expect("logged in");
    let reply = site.get(&engineer, "/setup/recipe/door.toml/drawing.json").await;
    let now: Value = serde_json::from_str(&reply.body).expect("JSON");
    assert_eq!((reply.status, &now["corners_px"][2]), (StatusCode::OK, &json!([90.0, 60.0])));
    let picture = site.get(&engineer, "/setup/recipe/door.toml/picture.png").await;
    assert_eq!(picture.headers["content-type"], "image/png");
    let reply = site.post(&engineer, "/setup/recipe/door.toml/proposal", &drawn().to_string()).await;
    let proposed: Value = serde_json::from_str(&reply.body).expect("JSON");
    assert_eq!((reply.status, &proposed["is_changed"]), (StatusCode::OK, &json!(true)), "{reply:?}");
    let [text, difference] = [&proposed["text"], &proposed["difference"]].map(|text| text.as_str().expect("text"));
    assert!(
        text.starts_with("panel = \"door\" # the left one") && text.contains("masked_px = [[[20, 20]"),
        "{text}"
    );
    assert!(
        difference.contains("<del>− corners_px = [[10, 10]")
            && difference.contains("<ins>+ corners_px = [[12, 10]")
    );
    let same = site.post(&engineer, "/setup/recipe/door.toml/proposal", &now.to_string()).await;
    let same: Value = serde_json::from_str(&same.body).expect("JSON");
    assert_eq!((&same["is_changed"], &same["text"]), (&json!(false), &json!(DOOR)));
    let change = json!({ "text": text, "why": "" }).to_string();
    let reply = site.post(&engineer, "/setup/recipe/door.toml", &change).await;
    assert_eq!(reply.status, StatusCode::UNPROCESSABLE_ENTITY, "a reason is asked for");
    // Two engineers have opened the same recipe: the second one who saves is informed, and overwrites nothing.
    let save = |before: &str| json!({ "text": text, "why": "wider", "before": before }).to_string();
    let saved = site.post(&engineer, "/setup/recipe/door.toml", &save(&content_hash(DOOR.as_bytes()))).await;
    assert_eq!(saved.status, StatusCode::OK, "{}", saved.body);
    assert!(saved.body.contains(&content_hash(text.as_bytes())), "the form continues: {}", saved.body);
    let late = site.post(&engineer, "/setup/recipe/door.toml", &save(&content_hash(b"an older text"))).await;
    assert_eq!(late.status, StatusCode::UNPROCESSABLE_ENTITY);
    assert!(late.body.contains("This recipe was changed after this page was opened"), "{}", late.body);
}

#[tokio::test]
async fn an_invalid_region_is_not_proposed() {
    let site = PageFixture::new();
    let engineer = site.log_in("engineer", PASSWORD).await.expect("logged in");
    let with = |key: &str, value: Value| {
        let mut body = drawn();
        body[key] = value;
        body.to_string()
    };
    for (body, words) in [
        (with("corners_px", json!([[90, 10], [10, 10], [90, 60], [10, 60]])), "must be in order around"),
        (with("held_px", json!([[[0, 0], [100, 0], [90, 9], [0, 9]]])), "outside the picture (100×80 px)"),
        (with("outline_px", json!([[97, 2], [2, 2], [97, 70], [2, 70]])), "the outline crosses itself"),
    ] {
        let told = site.post(&engineer, "/setup/recipe/door.toml/proposal", &body).await;
        assert!(told.status == StatusCode::UNPROCESSABLE_ENTITY && told.body.contains(words), "{told:?}");
    }
    for path in ["/setup/recipe/none.toml/proposal", "/setup/recipe/..%2Fcell.toml/proposal"] {
        let told = site.post(&engineer, path, &drawn().to_string()).await;
        assert_eq!(told.status, StatusCode::UNPROCESSABLE_ENTITY, "{path}");
    }
}

/// Without cameras the reason is reported, and the attempt is recorded in the audit trail.
#[tokio::test]
async fn a_picture_that_cannot_be_taken_gives_the_reason() {
    let site = PageFixture::new();
    let engineer = site.log_in("engineer", PASSWORD).await.expect("logged in");
    let told = site.post(&engineer, "/setup/cameras/scanner", "{}").await;
    assert!(told.status == StatusCode::CONFLICT && told.body.contains("has not opened its cameras"), "{told:?}");
    assert_eq!(site.post(&engineer, "/setup/cameras/other", "{}").await.status, StatusCode::NOT_FOUND);
    assert_eq!(site.get(&engineer, "/setup/cameras/scanner").await.status, StatusCode::NOT_FOUND);
    let audit = site.get(&engineer, "/audit").await.body;
    assert!(audit.contains("take a picture") && audit.contains("has not opened its cameras"), "{audit}");
}

/// The office's offer is shown with its differences; it is copied into the form if the person requests this, but is
/// not saved by this.
#[cfg(feature = "plant")]
#[tokio::test]
async fn a_recipe_of_the_office_is_shown_and_copied_by_a_person() {
    let site = PageFixture::new();
    let text = DOOR.replace("rows = 2", "rows = 3");
    let offer = RecipeOffer::new("door", &text, ("Anna <b>", "finer film"), 1_000).expect("an offer");
    site.transfers.office.record_offers(vec![offer]);
    let engineer = site.log_in("engineer", PASSWORD).await.expect("logged in");
    let page = site.get(&engineer, "/setup/recipe/door.toml").await.body;
    assert!(page.contains("Anna &lt;b&gt;") && page.contains("finer film"), "{page}");
    assert!(page.contains("<del>− rows = 2\n</del><ins>+ rows = 3\n</ins>"), "{page}");
    let in_form = |page: &str| page.split_once("<textarea").expect("a form").1.contains("rows = 3");
    assert!(!in_form(&page), "the form has the recipe as it is");
    let hash = page.split_once("?offer=").expect("a link").1.split('"').next().expect("a hash").to_owned();
    let taken = site.get(&engineer, &format!("/setup/recipe/door.toml?offer={hash}")).await.body;
    assert!(
        in_form(&taken) && taken.contains("value=\"Approved on the office server by Anna &lt;b&gt;: finer film\""),
        "{taken}"
    );
    let other = site.get(&engineer, "/setup/recipe/door.toml?offer=0000").await.body;
    assert!(!in_form(&other), "a hash that is not offered takes nothing");
    assert!(!site.get(&engineer, "/setup/recipe/panel.toml").await.body.contains("?offer="));
}
