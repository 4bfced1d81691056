//! The set-up of the cell: recipes with their problems, the equipment with the age of its calibrations, and the state
//! of the whole cell as `panelprep doctor` reports it: each item from the bottom up, with its findings and the remedy.
//!
//! A recipe's region, outline and masks are drawn on the picture of the taught scan. The drawing becomes a proposed
//! recipe text, which is shown with its differences. The text is approved and saved like every other change of a
//! recipe.

use super::answers::{Answer, panic_response, read_store};
use super::guard::{VisitorExtension, refusal};
use super::layout::{Frame, Script, local_time};
use super::page_texts::Language;
use super::state::{Web, entry, run_blocking};
use super::versions;
use super::versions::show_difference;
use crate::daemon::examination::{ExaminationOptions, ExaminedItem, examine_cell};
use crate::setup::{CellFiles, EquipmentList, clock::now_unix_ms, recipe_problems};
use axum::extract::{Path, Query, State};
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Response};
use axum::{Extension, Json};
use maud::{Markup, PreEscaped, html};
use panelprep_base::verdict::Verdict;
use panelprep_cell::accounts::{AuditEntry, Permission};
use panelprep_cell::files;
use panelprep_cell::files::content_hash;
use panelprep_cell::recipe::DrawnShapes;
use panelprep_interfaces::page::drawing::canvas;
use panelprep_store::office::RecipeOffer;
use panelprep_store::store::Store;
use serde::Deserialize;
use serde_json::json;
use std::sync::{Arc, PoisonError};

/// Recipes and equipment.
pub(super) async fn page(State(web): State<Arc<Web>>, Extension(visitor): VisitorExtension) -> Response {
    let source = web.front.setup.clone();
    let Some((recipes, equipment)) = run_blocking(move || (source.recipes(), source.list_equipment())).await else {
        return panic_response();
    };
    let words = visitor.language();
    let word = |key| words.text(key);
    let body = html! {
        section.card {
            h2 { (word("setup.recipes")) }
            @match recipes {
                Ok(recipes) => ul.links { @for recipe in &recipes { li { a href={ "/setup/recipe/" (recipe) } { (recipe) } } } },
                Err(problem) => p.told.bad { (problem) },
            }
        }
        section.card {
            h2 { (word("setup.cell")) }
            p.links {
                a href="/setup/cameras" { (word("cameras.title")) }
                @if visitor.has_permission(Permission::Configure) { " · " a href="/setup/doctor" { (word("doctor.title")) } }
            }
        }
        section.card {
            h2 { (word("setup.equipment")) }
            @match equipment {
                Ok(EquipmentList { verdict, reasons, items }) => {
                    p { (word(if verdict == Verdict::Reject { "setup.may_not_start" } else { "setup.may_start" })) }
                    ul { @for reason in &reasons { li { (reason) } } }
                    div.scroll tabindex="0" { table {
                        thead { tr { th { (word("setup.what")) } th { (word("setup.calibration")) } th { (word("setup.verification")) } } }
                        tbody { @for one in &items { tr { td { (one.name) } td { (one.calibration) } td { (one.verification) } } } }
                    } }
                }
                Err(problem) => p.told.bad { (problem) },
            }
        }
    };
    Frame { visitor: &visitor, title: word("nav.setup"), here: "/setup", scripts: &[] }.page(&body)
}

/// Shows one recipe: its text, its problems, and a form to change it for persons who may do so.
pub(super) async fn recipe(
    State(web): State<Arc<Web>>,
    Extension(visitor): VisitorExtension,
    Path(name): Path<String>,
    Query(OfferQuery { offer: taken }): Query<OfferQuery>,
) -> Answer {
    let (front, asked) = (web.front.clone(), name.clone());
    let read = run_blocking(move || {
        let recipe = front.setup.recipe(&asked)?;
        let problems = recipe_problems(&asked, &recipe.text);
        let not_taught = front.setup.not_taught(&asked, &recipe.text);
        let offer = front.recipe_offer(&asked)?;
        Ok::<_, String>((recipe, (problems, not_taught), offer))
    });
    let (recipe, (problems, not_taught), offer) = match read.await {
        Some(Ok(read)) => read,
        Some(Err(problem)) => return Err(refusal(StatusCode::NOT_FOUND, "recipe", &problem)),
        None => return Err(panic_response()),
    };
    let beginning = versions::audit_subject(&name, "");
    let versions = move |store: &Store| store.audit_of_subjects(versions::RECIPE_CHANGE, &beginning);
    let versions = read_store(&web, &visitor, versions).await?;
    let words = visitor.language();
    let word = |key| words.text(key);
    let body = html! {
        section.card {
            h2 { (name) }
            (verdict(&problems, word("setup.right")))
            (versions::show_warnings(words, &recipe.text, &versions))
            @if let Some(why) = &not_taught { p.told.bad { (word("setup.not_taught")) " " (why) } }
            @if visitor.has_permission(Permission::Configure) {
                p.links { a href={ "/setup/recipe/" (name) "/draw" } { (word("setup.draw")) } }
            }
            @if let Some(offer) = &offer { (show_offer(words, (&name, &recipe.text), offer)) }
            @if visitor.has_permission(Permission::Configure) {
                @let taken = offer.as_ref().filter(|offer| offer.hash() == taken);
                @let why = taken.map_or(String::new(), |offer| format!("{} {}: {}", word("setup.of_office"), offer.by, offer.why));
                form data-post={ "/setup/recipe/" (name) } {
                    input type="hidden" name="before" value=(content_hash(recipe.text.as_bytes()));
                    label { (word("setup.text")) textarea name="text" rows="30" spellcheck="false" {
                        (taken.map_or(recipe.text.as_str(), |offer| offer.text.as_str()))
                    } }
                    label { (word("setup.why")) input name="why" required maxlength="200" autocomplete="off" value=(why); }
                    p.told role="status" {}
                    div.buttons {
                        button type="submit" data-post="/setup/check" { (word("setup.check")) }
                        button.primary type="submit" { (word("setup.save")) }
                    }
                }
            } @else { pre.scroll tabindex="0" { (recipe.text) } }
            (versions::show_versions(words, &name, &versions))
        }
    };
    Ok(Frame { visitor: &visitor, title: &name, here: "/setup", scripts: &[Script::Forms] }.page(&body))
}

/// The hash of the office server's offer that is in the form.
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(super) struct OfferQuery {
    offer: String,
}

/// Shows the offer of the office server, its author and reason, its differences, and the link that copies it into the
/// form.
fn show_offer(words: Language<'_>, (name, text): (&str, &str), offer: &RecipeOffer) -> Markup {
    html! {
        section.review {
            h3 { (words.text("setup.offered")) }
            p { (offer.by) ", " (local_time(offer.unix_ms)) ": " (offer.why) }
            (versions::show_difference(text, &offer.text))
            p.links { a href={ "/setup/recipe/" (name) "?offer=" (offer.hash()) } { (words.text("setup.take")) } }
        }
    }
}

fn verdict(problems: &[String], right: &str) -> Markup {
    html! {
        @if problems.is_empty() { p { (right) } }
        @else { ul.told.bad { @for problem in problems { li { (problem) } } } }
    }
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RecipeTextForm {
    text: String,
    #[serde(default)]
    why: String,
    /// SHA-256 of the text on which the change is based; empty if it is not known.
    #[serde(default)]
    before: String,
}

/// Checks this text and returns its problems; nothing is written.
pub(super) async fn check_text(
    State(web): State<Arc<Web>>,
    Extension(visitor): VisitorExtension,
    Json(RecipeTextForm { text, .. }): Json<RecipeTextForm>,
) -> Response {
    let source = web.front.setup.clone();
    let name = "recipe.toml";
    match run_blocking(move || (recipe_problems(name, &text), source.not_taught(name, &text))).await {
        Some((problems, not_taught)) if problems.is_empty() => {
            let words = visitor.language();
            let missing = not_taught.map(|why| format!("\n{} {why}", words.text("setup.not_taught")));
            let message = format!("{}{}", words.text("setup.right"), missing.unwrap_or_default());
            Json(json!({ "message": message })).into_response()
        }
        Some((problems, _)) => refusal(StatusCode::UNPROCESSABLE_ENTITY, "recipe", &problems.join("\n")),
        None => panic_response(),
    }
}

/// Writes the recipe; the audit trail contains the text before and after the change, with the reason.
pub(super) async fn save(
    State(web): State<Arc<Web>>,
    Extension(visitor): VisitorExtension,
    Path(name): Path<String>,
    Json(RecipeTextForm { text, why, before: read }): Json<RecipeTextForm>,
) -> Response {
    if why.trim().is_empty() {
        return refusal(StatusCode::UNPROCESSABLE_ENTITY, "recipe", visitor.language().text("setup.why_missing"));
    }
    let subject = Some(versions::audit_subject(&name, why.trim()));
    let line = AuditEntry { subject, after: Some(text), ..entry(&visitor, versions::RECIPE_CHANGE) };
    let changed = visitor.language().text("setup.changed_meanwhile").to_owned();
    let after = content_hash(line.after.as_deref().unwrap_or_default().as_bytes());
    let kept = run_blocking(move || store_recipe(&web, &name, line, (&read, &changed)));
    match kept.await {
        // The form continues with the saved text.
        Some(Ok(removed_um)) => {
            let words = visitor.language();
            let author = AuditEntry { unix_ms: now_unix_ms(), ..entry(&visitor, versions::RECIPE_CHANGE) };
            let warning = removed_um.map(|um| format!(" {}", versions::removed_limit_warning(words, um, &author)));
            let message = format!("{}{}", words.text("saved"), warning.unwrap_or_default());
            Json(json!({ "message": message, "fields": { "before": after } })).into_response()
        }
        Some(Err(problem)) => refusal(StatusCode::UNPROCESSABLE_ENTITY, "recipe", &problem),
        None => panic_response(),
    }
}

/// Stores the changed text as the recipe. Under one lock, the present text is compared with the text on which the
/// change is based, the change is written to the audit trail, and the recipe is written. So if two people save at the
/// same time, the second one is informed, and nothing is written that is not in the audit trail. Returns the removal
/// limit, µm, if the change deleted it.
fn store_recipe(
    web: &Web,
    name: &str,
    line: AuditEntry,
    (read, changed): (&str, &str),
) -> Result<Option<f64>, String> {
    // A panic of another thread under this lock leaves nothing incomplete, because a file is written as a whole.
    let _turn = web.saving.lock().unwrap_or_else(PoisonError::into_inner);
    let setup = &web.front.setup;
    let text = line.after.clone().unwrap_or_default();
    let checked = setup.recipe(name).and_then(|now| {
        if !read.is_empty() && content_hash(now.text.as_bytes()) != read {
            return Err(changed.to_owned());
        }
        let problems = recipe_problems(name, &text);
        if problems.is_empty() { Ok(now.text) } else { Err(problems.join("\n")) }
    });
    let refused = |problem: String| {
        web.audit(&AuditEntry { refused: Some(problem.clone()), ..line.clone() });
        problem
    };
    let before = checked.map_err(refused)?;
    let removed_um = versions::removed_limit_um(&before, &text);
    let told = AuditEntry { before: Some(before), ..line.clone() };
    web.write(|store| store.store_audit(&told)).map_err(|error| {
        format!(
            "the audit trail cannot be written, so the recipe was not saved: {error}; save the recipe again later"
        )
    })?;
    setup.save_recipe(name, &text).map_err(refused)?;
    Ok(removed_um)
}

/// Examines the whole cell now, for one person at a time: it queries cameras, robot and disk.
pub(super) async fn doctor_page(State(web): State<Arc<Web>>, Extension(visitor): VisitorExtension) -> Answer {
    let Ok(_turn) = web.examining.acquire().await else { return Err(panic_response()) };
    let source = web.front.setup.clone();
    let Some(examined) = run_blocking(move || examine_cell(&ExaminationOptions::default(), source.paths())).await
    else {
        return Err(panic_response());
    };
    let words = visitor.language();
    let title = words.text("doctor.title");
    let frame = Frame { visitor: &visitor, title, here: "/setup", scripts: &[] };
    Ok(frame.page(&doctor_body(words, &examined)))
}

/// Shows the items with problems first, then the others, each group from the bottom up.
fn doctor_body(words: Language<'_>, examined: &[ExaminedItem]) -> Markup {
    let word = |key| words.text(key);
    let (right, wrong): (Vec<&ExaminedItem>, Vec<&ExaminedItem>) = examined.iter().partition(|one| one.is_passed());
    html! {
        section.card {
            h2 { (word("doctor.title")) }
            p { (word("doctor.right")) ": " (right.len()) " / " (examined.len()) }
            p.links { a href="/setup/doctor" { (word("doctor.again")) } }
            @if !wrong.is_empty() { h3 { "✖ " (word("doctor.wrong")) } p.note { (word("doctor.uppermost")) } }
            @for one in &wrong {
                article.alarm.high {
                    h3 lang="en" { (one.name) }
                    p lang="en" { (one.found) }
                    @if !one.advice.is_empty() { p { strong { (word("alarms.remedy")) ": " } span lang="en" { (one.advice) } } }
                }
            }
            h3 { "✓ " (word("doctor.right")) }
            div.scroll tabindex="0" { table { tbody {
                @for one in &right { tr { th scope="row" lang="en" { (one.name) } td lang="en" { (one.found) } } }
            } } }
        }
    }
}

/// Performs work with the recipes that may wait for a disk; an error becomes the response.
async fn with_recipes<T: Send + 'static>(
    web: &Web,
    work: impl FnOnce(&CellFiles) -> Result<T, String> + Send + 'static,
) -> Result<T, Response> {
    let source = web.front.setup.clone();
    match run_blocking(move || work(&source)).await {
        Some(Ok(done)) => Ok(done),
        Some(Err(problem)) => Err(refusal(StatusCode::UNPROCESSABLE_ENTITY, "recipe", &problem)),
        None => Err(panic_response()),
    }
}

/// Shows the drawing sheet with its tools, and the form that approves the drawing.
pub(super) async fn draw_page(
    State(web): State<Arc<Web>>,
    Extension(visitor): VisitorExtension,
    Path(name): Path<String>,
) -> Answer {
    let asked = name.clone();
    with_recipes(&web, move |source| source.recipe(&asked)).await?;
    let words = visitor.language();
    let word = |key| words.text(key);
    let own = format!("/setup/recipe/{}", encoded(&name));
    let title = format!("{}: {name}", word("setup.draw"));
    let sheet = canvas::sheet_markup(&format!("{own}/picture.png"), "", |key| words.text(key).to_owned());
    let body = html! {
        section.card {
            h2 { (title) }
            p.links { a href=(own) { (word("setup.text")) } }
            p.note { (word("setup.draw_note")) }
            p.told #told role="status" {}
            div.drawing data-recipe=(own) { (PreEscaped(sheet)) }
            button.primary #propose type="button" disabled { (word("setup.propose")) }
        }
        (approval_form(&own, &word))
    };
    Ok(Frame { visitor: &visitor, title: &title, here: "/setup", scripts: &[Script::Draw, Script::Forms] }
        .page(&body))
}

/// Shows the drawing as lines of the recipe, and the form that approves them.
fn approval_form<'w>(own: &str, word: &dyn Fn(&'w str) -> &'w str) -> Markup {
    html! {
        section.card #proposal hidden {
            h2 { (word("setup.proposal")) }
            div #difference {}
            form data-post=(own) data-then=(own) {
                input type="hidden" name="before";
                textarea name="text" hidden aria-label=(word("setup.text")) {}
                label { (word("setup.why")) input name="why" required maxlength="200" autocomplete="off"; }
                p.told role="status" {}
                button.primary type="submit" { (word("setup.save")) }
            }
        }
    }
}

fn encoded(name: &str) -> String {
    form_urlencoded::byte_serialize(name.as_bytes()).collect::<String>().replace('+', "%20")
}

/// Serves the picture of the taught scan.
pub(super) async fn picture(State(web): State<Arc<Web>>, Path(name): Path<String>) -> Answer {
    let png = with_recipes(&web, move |source| {
        let picture = source.taught_picture(&name)?;
        files::write_color_png(&picture).map_err(|error| error.to_string())
    });
    Ok(([(header::CONTENT_TYPE, "image/png")], png.await?).into_response())
}

/// Returns the content of the recipe as a drawing.
pub(super) async fn drawing(State(web): State<Arc<Web>>, Path(name): Path<String>) -> Answer {
    let drawn = with_recipes(&web, move |source| {
        let text = source.recipe(&name)?.text;
        canvas::check_recipe(&name, &text)
            .map(|recipe| canvas::recipe_shapes(&recipe))
            .map_err(|problems| problems.join("\n"))
    });
    Ok(Json(drawn.await?).into_response())
}

/// Returns the recipe's text with the drawn changes, if it has no errors; nothing is written.
pub(super) async fn propose(
    State(web): State<Arc<Web>>,
    Path(name): Path<String>,
    Json(drawn): Json<DrawnShapes>,
) -> Answer {
    let proposed = with_recipes(&web, move |source| {
        let before = source.recipe(&name)?.text;
        let picture = source.taught_picture(&name)?;
        let size_px = [picture.width, picture.height];
        let after = canvas::recipe_with_shapes((&name, &before), size_px, &drawn)
            .map_err(|problems| problems.join("\n"))?;
        match recipe_problems(&name, &after) {
            problems if problems.is_empty() => Ok((before, after)),
            problems => Err(problems.join("\n")),
        }
    });
    let (before, after) = proposed.await?;
    let difference = show_difference(&before, &after).into_string();
    let body = json!({
        "text": after, "is_changed": after != before, "difference": difference,
        "before": content_hash(before.as_bytes()),
    });
    Ok(Json(body).into_response())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::daemon::web::page_texts::Translations;
    use crate::daemon::web::tests::{DOOR, PageFixture};
    use std::fs;

    fn line(text: &str) -> AuditEntry {
        let (subject, after) = (Some("door.toml: finer".to_owned()), Some(text.to_owned()));
        AuditEntry {
            subject,
            after,
            ..AuditEntry::for_completed_action(None, None, "10.0.0.1".to_owned(), versions::RECIPE_CHANGE)
        }
    }

    #[test]
    fn of_two_simultaneous_saves_of_the_same_text_one_is_refused() {
        let site = PageFixture::new();
        let read = content_hash(DOOR.as_bytes());
        let save = |rows| {
            let text = DOOR.replace("rows = 2", rows);
            store_recipe(&site.web, "door.toml", line(&text), (&read, "changed meanwhile"))
        };
        let came = std::thread::scope(|scope| {
            let both = [scope.spawn(|| save("rows = 5")), scope.spawn(|| save("rows = 6"))];
            both.map(|one| one.join().expect("it ends"))
        });
        let told: Vec<_> = came.iter().filter_map(|came| came.as_ref().err()).collect();
        assert_eq!(told, ["changed meanwhile"], "exactly one is kept");
        let lines =
            site.web.read(|store| store.audit_of_subjects(versions::RECIPE_CHANGE, "door.toml: ")).expect("read");
        let now = site.web.front.setup.recipe("door.toml").expect("it");
        assert_eq!(lines.len(), 1);
        assert_eq!(lines[0].entry.after.as_deref(), Some(now.text.as_str()), "the one that the trail has");
    }

    #[test]
    fn a_recipe_that_the_audit_trail_cannot_store_is_not_written() {
        let site = PageFixture::new();
        let store = site.folder.path().join("store");
        fs::remove_dir_all(&store).expect("removed");
        fs::write(&store, "no folder").expect("written");
        let told =
            store_recipe(&site.web, "door.toml", line(&DOOR.replace("rows = 2", "rows = 5")), ("", "changed"));
        assert!(told.is_err_and(|told| told.contains("the audit trail cannot be written")));
        assert_eq!(site.web.front.setup.recipe("door.toml").expect("it").text, DOOR);
    }

    #[test]
    fn problems_are_shown_first_with_their_remedy() {
        let right = |name: &str| ExaminedItem::passed(name, format!("{name} <found>"));
        let robot = ExaminedItem::failed("robot", "robot <found>", "look at its cable");
        let examined = [right("disk"), robot, right("clock")];
        let words = Translations::read(None).expect("the program's own");
        let page = doctor_body(words.language(Some("en"), None), &examined).into_string();
        let at = |text: &str| page.find(text).unwrap_or_else(|| panic!("{text} is missing: {page}"));
        assert!(
            at("robot &lt;found&gt;") < at("look at its cable") && at("look at its cable") < at("disk"),
            "{page}"
        );
        assert!(page.contains("2 / 3") && at("disk") < at("clock"), "{page}");
        let well = doctor_body(words.language(Some("de"), None), &examined[..1]).into_string();
        assert!(well.contains("1 / 1") && !well.contains("✖"), "{well}");
    }
}
