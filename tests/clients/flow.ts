// The way of a lab in TypeScript, with the generated types: arguments are the address of the service, and a good build.
import { readFileSync } from "node:fs";
import createClient from "openapi-fetch";
import type { components, paths } from "./api";

type Submission = components["schemas"]["NewSubmissionBody"];

const [url, file] = process.argv.slice(2) as [string, string];
const client = createClient<paths>({ baseUrl: url });
const built = JSON.parse(readFileSync(file, "utf8")) as Submission;

function must<T>(answer: { data?: T; error?: unknown }): T {
  if (answer.data === undefined) throw new Error(JSON.stringify(answer.error));
  return answer.data;
}

async function until<T extends { state: string }>(state: string, look: () => Promise<T>): Promise<T> {
  for (let i = 0; i < 300; i++) {
    const found = await look();
    if (found.state === state) return found;
    await new Promise((resolve) => setTimeout(resolve, 100));
  }
  throw new Error(`never ${state}`);
}

const body = { agent: "typescript client", suite: "mineceraft" };
const run = must(await client.POST("/v1/runs", { body, params: { header: { "Idempotency-Key": "once in TypeScript" } } }));
const again = must(await client.POST("/v1/runs", { body, params: { header: { "Idempotency-Key": "once in TypeScript" } } }));
if (again.id !== run.id) throw new Error("an Idempotency-Key was used twice");
const accepted = must(await client.POST("/v1/submissions", { body: { ...built, run: run.id } }));
if (!("id" in accepted)) throw new Error("one submission has one identifier");
const path = { path: { id: accepted.id } };
const graded = await until("graded", async () => must(await client.GET("/v1/submissions/{id}", { params: path })));
if (graded.overall !== true) throw new Error(JSON.stringify(graded));
const report = must(await client.GET("/v1/submissions/{id}/report", { params: path }));
if (report.turns[0]?.checks[0]?.score !== 1) throw new Error(JSON.stringify(report));
must(await client.POST("/v1/runs/{id}/finish", { params: { path: { id: run.id } }, body: { skip: "unanswered" } }));
const done = await until("finished", async () => must(await client.GET("/v1/runs/{id}", { params: { path: { id: run.id } } })));
if (done.skipped !== done.tasks - 1) throw new Error(JSON.stringify(done));
const board = must(await client.GET("/v1/leaderboards/{suite}", { params: { path: { suite: "mineceraft" } } }));
if (typeof board === "string") throw new Error("a board is JSON unless another format is asked for");
if (!board.rows.some((row) => row.run === run.id)) throw new Error(JSON.stringify(board.rows));
const refused = await client.POST("/v1/runs", { body: { agent: "a", suite: "none" } });
if (refused.error?.faults?.[0]?.pointer !== "/suite") throw new Error(JSON.stringify(refused.error));
console.log("ok");
