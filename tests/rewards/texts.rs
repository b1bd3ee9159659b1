//! Texts of models as they come: long thoughts, JSON that is no log, JSON with a slip, and mistakes of those who send them.

use serde_json::{Value, json};

use crate::support::Service;

const WALL: &str =
    "for (let y = 0; y < 5; y++) for (let x = 0; x < 5; x++) await skills.placeBlock(bot, 'stone', x, y, 0);";

fn wall_log() -> String {
    let events: Vec<Value> =
        (0..25).map(|i| json!({ "action": "place", "x": i % 5, "y": i / 5, "z": 0, "material": "stone" })).collect();
    json!({ "events": events }).to_string()
}

fn service(folder: &tempfile::TempDir) -> Service {
    Service::start(&folder.path().join("p.db"), &[])
}

async fn graded(service: &Service, answer: &str) -> Value {
    let body = json!({ "task": "walls/5x1x5-raise", "answer": answer });
    let graded = service.post_json("/v1/grade", &body).await;
    assert_eq!(graded.status.as_u16(), 200, "{}", graded.text);
    graded.json()
}

#[tokio::test]
async fn thoughts_do_not_count_towards_the_size_of_code() {
    let folder = tempfile::tempdir().unwrap();
    let service = service(&folder);
    for thought in ["so ".repeat(200_000), "嗯\n".repeat(200_000)] {
        let answer = format!("<think>{thought}</think>\n```js\n{WALL}\n```");
        let graded = graded(&service, &answer).await;
        assert_eq!((&graded["reward"], &graded["answer"]["why"]), (&json!(1.0), &Value::Null));
    }
    let broken = graded(&service, "<think>a\nb</think>\n```js\nlet = 1;\n```").await;
    assert!(broken["answer"]["why"].as_str().unwrap().contains("in line 4"), "lines are those of the text: {broken}");
    let two = graded(&service, "```js\nlet a = 1;\n```\nand then\n```js\nlet b = 1;\n```").await;
    assert!(two["answer"]["why"].as_str().unwrap().contains("also what stands between fences"), "{two}");
}

/// Output of a model as it was decoded, with the thoughts and the tokens of its family, is read like the answer alone.
#[tokio::test]
async fn raw_output_of_every_family_is_read() {
    let folder = tempfile::tempdir().unwrap();
    let service = service(&folder);
    let wrong = "```js\nawait skills.placeBlock(bot, 'dirt', 9, 0, 9);\n```\nNo, not at [9]: again.";
    let families = [
        ("<think>", "</think>", "<|im_end|>"),
        ("", "</think>", "<|im_end|>\n<|endoftext|>"),
        ("[THINK]", "[/THINK]", "</s>"),
        ("◁think▷", "◁/think▷", "<|im_end|>"),
        ("<|START_THINKING|>", "<|END_THINKING|><|START_RESPONSE|>", "<|END_RESPONSE|>"),
        ("<|channel>thought\n", "<channel|>", "<turn|>"),
        (
            "<|channel|>analysis<|message|>",
            "<|end|><|start|>assistant<|channel|>commentary<|message|>Plan.<|end|><|start|>assistant<|channel|>final<|message|>",
            "<|return|>",
        ),
        ("analysis", "assistantfinal", ""),
        ("", "<|channel|>final <|constrain|>json<|message|>", "<|return|>"),
    ];
    for (opening, closing, end) in families {
        let script = format!("(async (bot) => {{\n{WALL}\n}})");
        for (suite, code) in [("mineceraft@2", script.as_str()), ("mineceraft@4", WALL)] {
            for answer in [format!("```js\n{code}\n```"), wall_log(), format!("\n{code}")] {
                let text = format!("{opening}{wrong}{closing}{answer}{end}");
                let body = json!({ "task": "walls/5x1x5-raise", "suite": suite, "answer": text });
                let graded = service.post_json("/v1/grade", &body).await.json();
                assert_eq!(graded["reward"], 1.0, "{suite} {text}: {graded}");
            }
        }
    }
}

/// A thought that the prompt opened and the end of the text cut off is no answer, also where its end names a channel.
#[tokio::test]
async fn thoughts_that_are_cut_off_are_no_answer() {
    let folder = tempfile::tempdir().unwrap();
    let service = service(&folder);
    let draft = format!("Draft:\n```js\n{WALL}\n```\nBut wait");
    for (prompt, whole, reward) in [
        ("<|im_start|>assistant\n<think>\n", draft.clone(), 0.0),
        ("<|im_start|>assistant\n<think>\n", format!("{draft}\n</think>\n```js\n{WALL}\n```<|im_end|>"), 1.0),
        ("<|im_start|>assistant\n", draft.clone(), 1.0),
        ("Build it.\n", format!("analysisWe build. {draft}"), 0.0),
    ] {
        let body =
            json!({ "query": [format!("{prompt}{whole}")], "prompts": [prompt], "labels": ["walls/5x1x5-raise"] });
        let rewarded = service.post_json("/get_reward", &body).await.json();
        assert_eq!(rewarded["rewards"], json!([reward]), "{prompt}{whole}: {rewarded}");
    }
    // Action code as a submission has it is read the same way.
    let script = format!("(async (bot) => {{\n{WALL}\n}})");
    for code in [
        format!("<think>plan</think>\n\n```js\n{script}\n```<｜end▁of▁sentence｜>"),
        format!("```js\n{script}```\nDone."),
        format!("<think>plan</think>\n{script}<|eot_id|>"),
        format!("```js\n{script}\n```<|im_end|>\n<|im_start|>user\nThanks!<|im_end|>"),
    ] {
        let turns = json!([{ "action_code": code }]);
        for body in [json!({ "turns": turns }), json!({ "answer": code })] {
            let mut body = body;
            body["task"] = "walls/5x1x5-raise".into();
            body["suite"] = "mineceraft@2".into();
            let graded = service.post_json("/v1/grade", &body).await.json();
            assert_eq!(graded["reward"], 1.0, "{code}: {graded}");
        }
    }
}

/// What stands beside a fence, or in its place, explains why code fails; where the code builds, nothing is said.
#[tokio::test]
async fn what_surrounds_code_explains_why_it_fails() {
    let folder = tempfile::tempdir().unwrap();
    let service = service(&folder);
    for (answer, told) in [
        (format!("```js linenums\n{WALL}\n```"), "\"linenums\" on the line of the code fence"),
        (format!("```javascript:build.js\n{WALL}\n```"), "\":build.js\" on the line of the code fence"),
        (format!("I build:\n{WALL}\nDone, I hope it's fine."), "without a code fence (```) the whole answer is read"),
        (format!("```js\nlog(bot, '<think>');\n{WALL}\n```"), "never closed: <think> in line 2"),
        (format!("```js\n{WALL}\0\n```"), "a null character (U+0000)"),
        (format!("```js\nconst build = async (bot) => {{\n{WALL}\n}};\n```"), "it defines build, which nothing calls"),
        (
            "```js\nasync function f(bot, skills) {\n  await skills.placeBlock(bot, 'stone', 0, 0, 0);\n}\n```"
                .to_owned(),
            "its parameter skills is undefined",
        ),
        ("```ts\nconst b = bot as any;\nawait skills.wait(b, 1);\n```".to_owned(), "which has no types"),
    ] {
        let graded = graded(&service, &answer).await;
        let notes = graded["action_code"][0]["notes"].to_string().replace("\\\"", "\"");
        assert!(notes.contains(told) && graded["reward"] == 0.0, "{answer}: {graded}");
    }
    let (one_line, bare) = (format!("```js {}\n```", WALL.replace('\n', " ")), WALL.to_owned());
    for answer in [one_line, bare, format!("```js\r\n{WALL}\r\n```")] {
        let graded = graded(&service, &answer).await;
        assert_eq!((&graded["reward"], &graded["action_code"][0]["notes"]), (&json!(1.0), &Value::Null), "{graded}");
    }
}

#[tokio::test]
async fn json_that_is_no_log_is_no_answer() {
    let folder = tempfile::tempdir().unwrap();
    let service = service(&folder);
    assert_eq!(graded(&service, &wall_log()).await["reward"], 1.0);
    let call = json!({ "name": "build", "arguments": { "code": WALL } }).to_string();
    let comma = wall_log().replace("}]}", "},]}");
    let quoted = wall_log().replace('"', "'");
    for (answer, why) in [
        (json!({ "code": WALL }).to_string(), "the JSON in the answer is not a block log"),
        (call.clone(), "the JSON in the answer is not a block log"),
        (format!("<think>hm</think>\n```json\n{call}\n```\n"), "the JSON in the answer is not a block log"),
        (comma.clone(), "JSON has no comma after the last value"),
        (format!("Here:\n```json\n{comma}\n```"), "is not valid in line 3"),
        (quoted.clone(), "JSON has straight double quotes around names and strings"),
        (format!("```json\n{quoted}\n```"), "JSON has straight double quotes around names and strings"),
        (wall_log().replacen("\"x\":0", "\"x\":NaN", 1), "JSON has no NaN"),
        (wall_log().replace("[{", "[ // the wall\n{"), "JSON has no comments"),
        // What is inside JSON that is cut off is no answer of its own.
        (format!("{{\"turns\":[{},{{\"events\":[", wall_log()), "the JSON that begins on line 1 is incomplete"),
        (format!("```\n{{\"action_code\": \"{}", WALL.replace('\n', " ")), "the JSON that begins on line 2 is incomplete"),
        (format!("{{\"turn1\":{0},\"turn2\":{0}}}", wall_log()), "has a member for each turn"),
        (wall_log().replacen("\"x\":0", "\"x\":0.5", 1), "/events/0/x: 0.5 is not an integer (in the JSON that begins on line 1)"),
        (format!("<think>\n```js\n{WALL}\n```\n</think>\nI have built it."), "its thoughts, which hold code, were left out"),
        (
            "<|channel|>analysis<|message|>Plan.<|end|><|start|>assistant<|channel|>commentary to=functions.act <|message|>{}<|call|>".to_owned(),
            "no message in the channel `final`",
        ),
    ] {
        for reward in ["strict", "mean"] {
            let body = json!({ "task": "walls/5x1x5-raise", "answer": answer, "reward": reward });
            let graded = service.post_json("/v1/grade", &body).await.json();
            assert_eq!(graded["reward"], 0.0, "{answer}: {graded}");
            assert!(graded["answer"]["why"].as_str().unwrap_or_default().contains(why), "{answer}: {graded}");
        }
    }
    // Where only code is read, a note says what JSON is.
    for code in [wall_log(), format!("```json\n{}\n```", wall_log())] {
        let body = json!({ "profile": "mindcraft", "action_code": code });
        let replayed = service.post_json("/v1/replay", &body).await;
        assert!(replayed.text.contains("send a block log as events, rows or turns"), "{}", replayed.text);
    }
}

/// What the code of an answer did not do is explained wherever code is taken, and under both profiles.
#[tokio::test]
async fn what_is_left_out_of_code_is_told_at_every_door() {
    let folder = tempfile::tempdir().unwrap();
    let service = service(&folder);
    let build = format!("(async (bot) => {{\n{WALL}\n}})");
    for (profile, code, told) in [
        ("published", format!("<think>\nI need a wall.\n```js\n{build}\n```"), "never closed: <think> in line 1"),
        (
            "published",
            format!("```js\n{build}\n```\nThen\n```js\nawait wall(bot);\n```"),
            "of 2 code fences the last alone is run",
        ),
        ("published", format!("Sure:\n```js\n{}", &build[..build.len() / 2]), "ends without a closing fence"),
        ("mindcraft", "/fill 0 0 0 4 4 0 stone".to_owned(), "a command is sent by code"),
        (
            "mindcraft",
            "{\"events\": [{\"action\": \"place\",".to_owned(),
            "the JSON that begins on line 1 is incomplete",
        ),
    ] {
        let replayed = service.post_json("/v1/replay", &json!({ "profile": profile, "action_code": code })).await;
        assert!(replayed.text.contains(told), "{code}: {}", replayed.text);
        let body = json!({ "task": 113, "profile": profile, "turns": [{ "action_code": code }] });
        let graded = service.post_json("/v1/grade", &body).await;
        assert!(graded.text.contains(told), "{code}: {}", graded.text);
    }
    // A mark that some editors write before the text hides no fence.
    let marked = json!({ "profile": "published", "action_code": format!("\u{feff}```js\n{build}\n```") });
    assert_eq!(service.post_json("/v1/replay", &marked).await.json()["events"].as_array().map(Vec::len), Some(25));
    // An answer that was found says what came after it.
    let answer = json!({ "task": 113, "profile": "published", "answer": format!("```js\n{build}\n```\n<think>Or") });
    let found = service.post_json("/v1/grade", &answer).await.json()["answer"]["found"][0].clone();
    assert!(found["left_out"].as_str().is_some_and(|why| why.contains("<think> in line")), "{found}");
    // Code in a list, one text for each file, is code.
    let answer = json!({ "task": 113, "profile": "mindcraft", "answer": json!({ "action_code": [WALL] }).to_string() });
    assert_eq!(service.post_json("/v1/grade", &answer).await.json()["reward"], 1.0);
}

#[tokio::test]
async fn a_prompt_that_stays_in_the_answer_is_told() {
    let folder = tempfile::tempdir().unwrap();
    let service = service(&folder);
    let prompt = "Raise a wall.";
    let body = json!({ "query": [format!("{prompt}{WALL}"), format!("{prompt}{WALL}"), "?"],
                       "prompts": [prompt, "Raise a roof.", "?"], "labels": [113, 113, 113] });
    let told = service.post_json("/get_reward", &body).await.json();
    assert_eq!(told["rewards"], json!([1.0, 0.0, 0.0]), "{told}");
    let problems: Vec<&str> =
        told["problems"].as_array().unwrap().iter().map(|problem| problem["detail"].as_str().unwrap()).collect();
    assert!(problems[0].ends_with("the query does not begin with its prompt, so all of it was read as the answer"));
    assert!(!problems[1].contains("prompt"), "{told}");
}

#[tokio::test]
async fn faults_of_a_batch_have_the_lines_of_its_body() {
    let folder = tempfile::tempdir().unwrap();
    let service = service(&folder);
    let half = json!({ "task": 113, "turns": [{ "events": [{ "action": "place", "x": 0.5, "y": 0, "z": 0, "material": "a" }] }] });
    let twice = json!({ "task": 113, "turns": [{ "events": [] }, { "events": [] }] });
    let answer =
        service.post("/v1/grade:batch", "application/x-ndjson", format!("\n{{\"task\":\n\n{half}\n{twice}\n")).await;
    let mut items: Vec<Value> = answer.text.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    items.sort_by_key(|item| item["index"].as_u64());
    let faults: Vec<&Value> = items.iter().map(|item| &item["error"]["faults"][0]).collect();
    assert_eq!(faults.iter().map(|fault| &fault["line"]).collect::<Vec<_>>(), [2, 4, 5], "{faults:#?}");
    assert_eq!(faults[0]["detail"], "cut off within a value at column 8");
    let pretty = serde_json::to_string_pretty(&json!({ "task": 113, "turns": [{ "events": [] }] })).unwrap();
    let told = service.post("/v1/validate", "application/x-ndjson", pretty).await;
    assert_eq!(told.faults(400).len(), 1, "{}", told.text);
    assert!(told.text.contains("one JSON document over several lines"), "{}", told.text);
}

#[tokio::test]
async fn parameters_that_would_have_no_effect_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let service = service(&folder);
    let run = service.begin_run("a", "mineceraft-lite").await;
    let body = json!({ "task": 113, "turns": [{ "events": [] }] });
    for path in [
        format!("/v1/runs/{run}/finish?skip=unanswered"),
        "/v1/grade?reward=mean".to_owned(),
        "/v1/submissions?suite=mineceraft@1".to_owned(),
        "/v1/validate?suite=mineceraft@1".to_owned(),
    ] {
        let refused = service.post_json(&path, &body).await;
        assert_eq!(refused.faults(400).len(), 1, "{path}: {}", refused.text);
        let problem = refused.json();
        assert_eq!(problem["type"], "urn:plumbline:problem:invalid-query");
        assert!(problem["faults"][0]["detail"].as_str().unwrap().contains("goes into the body"), "{path}: {problem}");
    }
    assert_eq!(service.get(&format!("/v1/runs/{run}")).await.json()["state"], "open", "nothing was done");
    for path in ["/v1/blocks?limit=2".to_owned(), "/v1/limits?x=1".to_owned(), format!("/v1/runs/{run}?foo=1&bar")] {
        assert_eq!(service.get(&path).await.status.as_u16(), 400, "{path}");
    }
    let head = service.http.head(format!("{}/v1/limits?x=1", service.url)).send().await.unwrap();
    assert_eq!(head.status().as_u16(), 400);
    let with_key = format!("/with-key/plk_{}/v1/grade?reward=mean", "a".repeat(40));
    assert_eq!(service.post_json(&with_key, &body).await.status.as_u16(), 400);
    for path in ["/v1/limits?", "/v1/limits?&", "/v1/tasks?family=walls", "/healthz?x=1", "/?x=1"] {
        assert_eq!(service.get(path).await.status.as_u16(), 200, "{path}");
    }
}

#[tokio::test]
async fn names_that_are_nearly_right_are_suggested() {
    let folder = tempfile::tempdir().unwrap();
    let service = service(&folder);
    let turns = json!([{ "events": [] }]);
    for (body, told) in [
        (json!({ "task": 113, "suite": "minecraft", "turns": turns }), "did you mean mineceraft"),
        (json!({ "task": 113, "suite": "MineCEraft", "turns": turns }), "did you mean mineceraft"),
        (json!({ "task": "113", "turns": turns }), "give 113 as a number"),
        (json!({ "task": "Walls/5x1x5-Raise", "turns": turns }), "did you mean walls/5x1x5-raise"),
        (json!({ "task": 113, "messages": [] }), "send what the model wrote as \\\"answer\\\""),
    ] {
        let refused = service.post_json("/v1/grade", &body).await;
        assert_eq!(refused.status.as_u16(), 422, "{}", refused.text);
        assert!(refused.text.contains(told), "{body}: {}", refused.text);
    }
}

/// What a model thinks may be longer than any code; only the code is bounded as code, at every door.
#[tokio::test]
async fn long_thoughts_are_no_code() {
    let folder = tempfile::tempdir().unwrap();
    let service = service(&folder);
    let code = format!("Here:\n```js\n(async (bot) => {{ {WALL} }})\n```\n");
    let thought = |bytes: usize| format!("<think>{}</think>{code}", "Should it be dirt?\n".repeat(bytes / 19));
    let submission = |text: String| json!({ "task": "walls/5x1x5-raise", "turns": [{ "action_code": text }] });
    let accepted = service.post_json("/v1/submissions", &submission(thought(600_000))).await.json();
    let path = format!("/v1/submissions/{}", accepted["id"].as_str().unwrap());
    let ended = service.wait_for(&path, |submission| submission["state"] == "graded").await;
    assert_eq!(ended["action_code"][0]["events"], json!(25), "{ended}");
    let graded = graded(&service, &thought(600_000)).await;
    assert_eq!(graded["criteria"][0]["mean"], json!(1.0), "{graded}");
    for (text, told) in [
        (thought(5_000_000), "bytes; at most 4194304"),
        (format!("{code}{}", "// dirt?\n".repeat(70_000)), "bytes without thoughts; at most 524288"),
    ] {
        let refused = service.post_json("/v1/submissions", &submission(text)).await;
        assert_eq!(refused.faults(422), ["null /turns/0/action_code"]);
        assert!(refused.text.contains(told), "{}", refused.text);
    }
}
