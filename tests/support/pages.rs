//! Routes of the pages as the service declares them, so that a list in a test cannot forget a page.

/// Source in which the pages are routed.
const SOURCE: &str = include_str!("../../src/http/pages/mod.rs");

/// Fails unless each route that serves a page, a picture or a table is asked for. `paths` may have queries.
pub fn must_be_asked_for(paths: &[String], is_needed: impl Fn(&str) -> bool) {
    let routes: Vec<&str> = SOURCE.lines().filter_map(route_in).filter(|route| is_needed(route)).collect();
    assert!(routes.len() > 10, "the routes are declared elsewhere now: {routes:?}");
    let is_asked = |route: &str| paths.iter().any(|path| is_of(route, path.split('?').next().unwrap_or_default()));
    let forgotten: Vec<&str> = routes.into_iter().filter(|route| !is_asked(route)).collect();
    assert!(forgotten.is_empty(), "add a path of each of these pages to the list of this test: {forgotten:?}");
}

/// Returns the route that a line declares, if it serves a document of its own.
fn route_in(line: &str) -> Option<&str> {
    let route = line.trim().strip_prefix(".route(\"")?.split('"').next()?;
    (!line.contains("Redirect::") && !route.starts_with("/assets/")).then_some(route)
}

/// Returns whether a path is one of a route with parameters.
fn is_of(route: &str, path: &str) -> bool {
    let (mut own, mut sent) = (route.split('/'), path.split('/'));
    loop {
        match (own.next(), sent.next()) {
            (None, None) => return true,
            (Some(own), Some(_)) if own.starts_with("{*") => return true,
            (Some(own), Some(sent)) if own == sent || (own.starts_with('{') && !sent.is_empty()) => {}
            _ => return false,
        }
    }
}

#[test]
fn a_route_matches_its_paths_alone() {
    assert!(is_of("/runs/{id}/tasks/{number}", "/runs/r/tasks/3") && is_of("/agents/{*name}", "/agents/a/b"));
    assert!(!is_of("/runs/{id}", "/runs/r/tasks/3") && !is_of("/runs/{id}", "/runs/") && !is_of("/", "/runs"));
}
