//! A folder of large logs that is not mounted: nothing is written below its mount point, and nothing is lost.

use super::blobs::{LARGE, SMALL, Scene, files, graded, post, scattered};
use crate::support::Service;
use crate::support::commands::{plumbline, succeeded};

#[tokio::test]
async fn a_folder_that_is_not_mounted_loses_nothing() {
    let scene = Scene::new();
    let service = scene.start("p.db", &["--blobs", &scene.blobs("share")]);
    let first = post(&service, &scattered(LARGE, 1)).await;
    graded(&service, &first).await;
    assert!(service.get("/readyz").await.json().get("lacks").is_none());

    // A share that goes away leaves its mount point, an empty folder.
    std::fs::rename(scene.path("share"), scene.path("away")).unwrap();
    std::fs::create_dir(scene.path("share")).unwrap();
    let is_refused = async |service: &Service| {
        let answer = service.post_json("/v1/submissions", &scattered(LARGE, 2)).await;
        assert_eq!(answer.status, 503, "{}", answer.text);
        assert!(answer.json()["retryable"] == true && answer.text.contains("does not answer"), "{}", answer.text);
        let read = service.get(&format!("/v1/submissions/{first}/log")).await;
        assert_eq!((read.status.as_u16(), read.json()["retryable"].clone()), (503, true.into()), "{}", read.text);
        let told = service.wait_for("/readyz", |ready| ready.get("lacks").is_some()).await;
        assert_eq!(told["lacks"][0], "folder of large logs and reports");
    };
    is_refused(&service).await;
    let small = post(&service, &scattered(SMALL, 3)).await;
    graded(&service, &small).await;
    service.kill();
    let service = scene.start("p.db", &[]);
    is_refused(&service).await;
    assert_eq!(files(&scene.path("share")), Vec::<String>::new(), "nothing is written below the mount point");

    // Nor is another place taken for it.
    std::fs::write(scene.path("share").join("plumbline.id"), "another").unwrap();
    is_refused(&service).await;
    std::fs::remove_dir_all(scene.path("share")).unwrap();
    std::fs::rename(scene.path("away"), scene.path("share")).unwrap();
    let second = post(&service, &scattered(LARGE, 2)).await;
    for id in [&first, &second] {
        graded(&service, id).await;
        assert_eq!(service.get(&format!("/v1/submissions/{id}/log")).await.status.as_u16(), 200);
    }

    // Nor before the first large log: the place has its identifier since the first start.
    let fresh = scene.start("fresh.db", &["--blobs", &scene.blobs("fresh")]);
    fresh.kill();
    std::fs::rename(scene.path("fresh"), scene.path("fresh-away")).unwrap();
    std::fs::create_dir(scene.path("fresh")).unwrap();
    let fresh = scene.start("fresh.db", &[]);
    assert_eq!(fresh.post_json("/v1/submissions", &scattered(LARGE, 4)).await.status, 503);
    assert_eq!(files(&scene.path("fresh")), Vec::<String>::new());
    // Without even a mount point it starts too, and finds the folder once it is there.
    fresh.kill();
    std::fs::remove_dir(scene.path("fresh")).unwrap();
    let fresh = scene.start("fresh.db", &[]);
    assert_eq!(fresh.post_json("/v1/submissions", &scattered(LARGE, 4)).await.status, 503);
    assert!(!scene.path("fresh").exists());
    std::fs::rename(scene.path("fresh-away"), scene.path("fresh")).unwrap();
    let large = post(&fresh, &scattered(LARGE, 4)).await;
    graded(&fresh, &large).await;

    // Where the identifier alone is lost, the service and `check` say what it was.
    fresh.kill();
    let identifier = scene.path("fresh").join("plumbline.id");
    let id = std::fs::read_to_string(&identifier).unwrap();
    std::fs::remove_file(&identifier).unwrap();
    let checked = plumbline(&["check"], &scene.path("fresh.db"));
    let told = String::from_utf8_lossy(&checked.stdout);
    assert!(checked.status.code() == Some(2) && told.contains(&format!("write {id} into it")), "{told}");
    std::fs::write(&identifier, &id).unwrap();
    let checked = succeeded(&plumbline(&["check"], &scene.path("fresh.db")));
    assert!(checked.contains("nothing is damaged"), "{checked}");

    // What is gone for good is not said to pass.
    let lost = scene.reference("p.db", &second).await.unwrap();
    std::fs::remove_file(scene.path("share").join(lost)).unwrap();
    let read = service.get(&format!("/v1/submissions/{second}/log")).await;
    assert_eq!((read.status.as_u16(), read.json()["retryable"].clone()), (500, false.into()), "{}", read.text);
}
