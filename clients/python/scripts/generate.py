"""Writes the models and the methods of both clients from the OpenAPI document.

Usage: python scripts/generate.py DOCUMENT FOLDER

Writes models.py (with datamodel-codegen), resources.py and async_resources.py into the folder. The test of the package
writes them elsewhere and compares, so that the client and the document cannot part.
"""

from __future__ import annotations

import json
import re
import subprocess
import sys
import tempfile
import textwrap
from pathlib import Path
from typing import Any

Schema = dict[str, Any]

# Resource and method of each operation. An operation without a place here is an error.
PLACES = {
    "get_receipt_keys": "receipts.keys",
    "get_receipt": "receipts.of_submission",
    "list_receipts": "receipts.list",
    "aggregate_metrics": "nemo_gym.aggregate_metrics",
    "seed_session": "nemo_gym.seed_session",
    "close_session": "nemo_gym.close_session",
    "reverify_mode": "nemo_gym.reverify_mode",
    "verify": "nemo_gym.verify",
    "get_reward": "rewards.openrlhf",
    "grade": "rewards.grade",
    "grade_structure": "rewards.grade_structure",
    "get_health": "service.health",
    "get_readiness": "service.readiness",
    "get_metrics": "service.metrics",
    "get_openapi": "service.openapi",
    "get_limits": "service.limits",
    "list_profiles": "service.profiles",
    "list_blocks": "service.blocks",
    "get_quota": "service.quota",
    "get_agent_guide": "tasks.agent_guide",
    "list_tasks": "tasks.list",
    "get_task": "tasks.get",
    "list_suites": "suites.list",
    "get_suite": "suites.get",
    "create_run": "runs.create",
    "put_run_card": "runs.put_card",
    "get_run_card": "runs.card",
    "put_entry_card": "entries.put_card",
    "get_entry_card": "entries.card",
    "get_run": "runs.get",
    "list_runs": "runs.list",
    "finish_run": "runs.finish",
    "delete_run": "runs.delete",
    "withdraw_run": "runs.withdraw",
    "lift_embargo": "runs.lift_embargo",
    "get_team": "team.get",
    "put_member": "team.put_member",
    "remove_member": "team.remove_member",
    "create_member_key": "team.create_key",
    "revoke_team_key": "team.revoke_key",
    "create_webhook": "webhooks.create",
    "list_webhooks": "webhooks.list",
    "get_webhook": "webhooks.get",
    "put_webhook": "webhooks.put",
    "delete_webhook": "webhooks.delete",
    "change_webhook_secret": "webhooks.change_secret",
    "test_webhook": "webhooks.test",
    "list_deliveries": "webhooks.deliveries",
    "retry_delivery": "webhooks.retry",
    "list_run_submissions": "runs.submissions",
    "create_board_action": "boards.act",
    "get_leaderboard": "boards.get",
    "get_breakdown": "boards.breakdown",
    "get_comparison": "boards.compare",
    "get_repeats": "boards.repeats",
    "list_board_actions": "boards.actions",
    "get_board_feed": "boards.feed",
    "create_submission": "submissions.create",
    "validate_submission": "submissions.validate",
    "get_submission": "submissions.get",
    "cancel_submission": "submissions.cancel",
    "get_log": "submissions.log",
    "get_report": "submissions.report",
    "get_stress": "submissions.stress",
    "get_structure": "submissions.structure",
    "replay_action_code": "submissions.replay",
    "open_episode": "episodes.open",
    "get_episode": "episodes.get",
    "step_episode": "episodes.step",
    "next_turn": "episodes.next_turn",
    "view_episode": "episodes.view",
    "picture_episode": "episodes.picture",
    "submit_episode": "episodes.submit",
    "list_epochs": "epochs.list",
    "get_epoch": "epochs.get",
    "get_epoch_answers": "epochs.answers",
    "get_epoch_leaderboard": "epochs.leaderboard",
    "get_epoch_reveal": "epochs.reveal",
    "create_epoch_pool": "epochs.bring_round",
    "list_siblings": "epochs.siblings",
    "create_entry": "entries.create",
    "get_entry": "entries.get",
    "finalize_entry": "entries.finalize",
    "create_instances": "entries.draw",
    "get_instance": "instances.get",
    "answer_instance": "instances.answer",
    "get_instance_report": "instances.report",
    "get_instance_receipt": "instances.receipt",
    "check_transcript": "instances.check_transcript",
}

# Written by hand, because they stream.
BY_HAND = {"grade_batch", "get_events"}

# Requests that may be sent again when nobody knows whether the first one arrived. Requests that read, and those with
# an Idempotency-Key, may always.
REPEATABLE = {
    "aggregate_metrics", "seed_session", "close_session", "verify", "get_reward", "grade", "grade_structure",
    "finish_run", "validate_submission", "cancel_submission", "replay_action_code", "finalize_entry",
    "answer_instance", "check_transcript", "put_run_card", "put_entry_card", "put_member", "put_webhook",
}  # fmt: skip
# May be sent again if this member says which of the requests it is.
NUMBERED = {"step_episode": "step", "next_turn": "step"}

# Names that a method cannot use for a parameter.
RENAMED = {"from": "from_", "for": "for_", "id": "id", "Idempotency-Key": "idempotency_key"}

HEADER = '"""{about}\n\nGenerated by scripts/generate.py from the OpenAPI document; not for editing.\n"""\n'


def resolve(document: Schema, schema: Schema) -> Schema:
    while "$ref" in schema:
        schema = document["components"]["schemas"][schema["$ref"].rsplit("/", 1)[1]]
    return schema


def openly(document: Schema) -> Schema:
    """Returns the document with enumerations that only responses use as open ones, so that an older client reads what
    a newer service answers."""
    asked: set[str] = set()
    for path in document["paths"].values():
        for operation in path.values():
            asked |= mentioned(document, [operation.get("parameters", []), operation.get("requestBody", {})], asked)
    opened: Schema = json.loads(json.dumps(document))
    for name, schema in opened["components"]["schemas"].items():
        if "enum" in schema and name not in asked:
            about = schema.get("description", "")
            opened["components"]["schemas"][name] = {"description": about, "anyOf": [schema, {"type": "string"}]}
    return opened


def mentioned(document: Schema, part: Any, known: set[str]) -> set[str]:
    """Returns the names of all schemas that a part of the document refers to, itself or through others."""
    found: set[str] = set()
    if isinstance(part, dict):
        if "$ref" in part:
            name = part["$ref"].rsplit("/", 1)[1]
            if name not in known:
                found.add(name)
                found |= mentioned(document, document["components"]["schemas"][name], known | found)
        for value in part.values():
            found |= mentioned(document, value, known | found)
    elif isinstance(part, list):
        for value in part:
            found |= mentioned(document, value, known | found)
    return found


def write_models(document: Schema, output: Path) -> None:
    # In a folder of its own: settings of a project around it would change the lines.
    with tempfile.TemporaryDirectory() as folder:
        source, target = Path(folder) / "document.json", Path(folder) / "models.py"
        source.write_text(json.dumps(openly(document)))
        command = [str(Path(sys.executable).parent / "datamodel-codegen"), "--input", str(source)]
        command += ["--input-file-type", "openapi", "--output", str(target), "--disable-timestamp"]
        command += ["--output-model-type", "pydantic_v2.BaseModel", "--target-python-version", "3.11"]
        command += ["--use-annotated", "--use-union-operator", "--use-standard-collections", "--use-double-quotes"]
        command += ["--enum-field-as-literal", "all", "--use-schema-description", "--use-field-description"]
        command += ["--collapse-root-models", "--allow-population-by-field-name", "--formatters", "builtin"]
        command += ["--custom-file-header", HEADER.format(about="Bodies of requests and responses.")]
        subprocess.run(command, check=True, cwd=folder)
        output.write_text(target.read_text())


def annotation(document: Schema, schema: Schema) -> str:
    """Returns the Python type of what a caller may pass for a schema."""
    if "$ref" in schema:
        name, target = schema["$ref"].rsplit("/", 1)[1], resolve(document, schema)
        if target.get("type") == "object" and "properties" in target:
            return f"models.{name} | Mapping[str, Any]"
        return annotation(document, target)
    if "enum" in schema:
        return "Literal[" + ", ".join(json.dumps(value) for value in schema["enum"]) + "]"
    for key in ("oneOf", "anyOf"):
        if key in schema:
            return union(annotation(document, part) for part in schema[key])
    kinds = schema.get("type", "any")
    kinds = [kinds] if isinstance(kinds, str) else kinds
    return union(simple(document, kind, schema) for kind in kinds)


def simple(document: Schema, kind: str, schema: Schema) -> str:
    if kind == "array":
        return f"Sequence[{annotation(document, schema.get('items', {}))}]"
    if kind == "string":
        return {"uuid": "str | UUID", "binary": "bytes"}.get(schema.get("format", ""), "str")
    return {"integer": "int", "number": "float", "boolean": "bool", "null": "None", "object": "Mapping[str, Any]"}.get(
        kind, "Any"
    )


def union(parts: Any) -> str:
    split = (one.strip() for part in parts for one in top_level(part))
    unique = list(dict.fromkeys(split))
    if "None" in unique:
        unique = [one for one in unique if one != "None"] + ["None"]
    return " | ".join(unique)


def top_level(text: str) -> list[str]:
    """Splits a type at its outermost bars."""
    parts, depth = [""], 0
    for character in text:
        depth += (character in "[(") - (character in "])")
        if character == "|" and depth == 0:
            parts.append("")
        else:
            parts[-1] += character
    return parts


class Method:
    """A method of a resource."""

    def __init__(self, document: Schema, verb: str, path: str, operation: Schema) -> None:
        self.document, self.verb, self.path, self.operation = document, verb.upper(), path, operation
        self.id: str = operation["operationId"]
        self.resource, self.name = PLACES[self.id].split(".")
        self.body = operation.get("requestBody", {}).get("content", {})
        good = next(answer for code, answer in operation["responses"].items() if code.startswith("2"))
        self.answers: dict[str, Schema] = {kind: part["schema"] for kind, part in good.get("content", {}).items()}
        self.parameters = operation.get("parameters", [])

    def variants(self) -> list[tuple[str, str, list[str]]]:
        """Returns name, media type and the formats of each method: one for JSON, and one for the text formats."""
        formats = next((p for p in self.parameters if p["name"] == "format"), None)
        texts = [kind for kind in self.answers if kind != "application/json"]
        if "application/json" not in self.answers:
            return [(self.name, texts[0], [])]
        if formats is None or not texts:
            return [(self.name, "application/json", [])]
        named = [value for value in resolve(self.document, formats["schema"])["enum"] if value != "json"]
        return [(self.name, "application/json", []), (f"{self.name}_as", texts[0], named)]

    def members(self) -> dict[str, tuple[str, bool]]:
        """Returns the members of the JSON body that are parameters of the method: type, and whether it is required."""
        schema = self.body.get("application/json", {}).get("schema")
        if schema is None:
            return {}
        parts = [part for part in schema.get("oneOf", [schema]) if part.get("type") != "null"]
        target = resolve(self.document, parts[0])
        required = target.get("required", [])
        return {
            name: (annotation(self.document, part), name in required)
            for name, part in target.get("properties", {}).items()
        }

    def write(self, is_async: bool) -> str:
        return "\n".join(self.write_variant(is_async, *variant) for variant in self.variants())

    def write_variant(self, is_async: bool, name: str, kind: str, formats: list[str]) -> str:
        positional, keywords, query = [], [], []
        path = self.path
        for parameter in self.parameters:
            label = RENAMED.get(parameter["name"], parameter["name"])
            kind_of = annotation(self.document, parameter["schema"])
            if parameter["in"] == "path":
                positional.append(f"{label}: str | UUID" if label == "id" else f"{label}: {kind_of}")
            elif parameter["in"] == "query" and parameter["name"] == "format" and formats:
                keywords.append("format: Literal[" + ", ".join(json.dumps(value) for value in formats) + "]")
                query.append('"format": format')
            elif parameter["in"] == "query" and not (parameter["name"] == "format" and self.has_text()):
                needs = parameter.get("required", False)
                optional = kind_of if needs else union([kind_of, "None"])
                keywords.append(f"{label}: {optional}" + ("" if needs else " = None"))
                query.append(f'"{parameter["name"]}": {label}')
        path = re.sub(r"{(\w+)}", r"{quoted(\1)}", path)
        if self.id == "get_task":
            positional, path = ["task: str"], "/v1/tasks/{quoted(task, safe='/')}"
        members, sent = self.members(), []
        if "application/octet-stream" in self.body:
            positional.insert(0, "file: bytes")
            sent.append("content=file")
        elif members:
            needed = [f"{label}: {kind_of}" for label, (kind_of, needs) in members.items() if needs]
            others = [f"{label}: {union([k, 'None'])} = None" for label, (k, needs) in members.items() if not needs]
            keywords = needed + keywords + others
            sent.append("json=given({" + ", ".join(f'"{label}": {label}' for label in members) + "})")
        elif self.body:
            positional.append("body: Mapping[str, Any]")
            sent.append("json=body")
        if query:
            sent.append("params={" + ", ".join(query) + "}")
        if any(p["name"] == "Idempotency-Key" for p in self.parameters):
            keywords.append("idempotency_key: str | None = None")
            sent.append("once=idempotency_key or new_key()")
        elif self.id in REPEATABLE:
            sent.append("is_repeatable=True")
        elif self.id in NUMBERED:
            sent.append(f"is_repeatable={NUMBERED[self.id]} is not None")
        keywords.sort(key=lambda keyword: "=" in keyword)
        returned, adapter = self.returned(kind)
        parameters = ", ".join(["self", *positional, *(["*"] if keywords else []), *keywords])
        arguments = ", ".join([adapter, f'"{self.verb}"', ("f" if "{" in path else "") + json.dumps(path), *sent])
        define, wait = ("async def", "await ") if is_async else ("def", "")
        about = textwrap.fill(self.about(), 110, subsequent_indent=" " * 8)
        end = "\n        " if "\n" in about else ""
        return (
            f"    {define} {name}({parameters}) -> {returned}:\n"
            f'        """{about}{end}"""\n'
            f"        return {wait}self._client._call({arguments})\n"
        )

    def about(self) -> str:
        text = self.operation.get("description") or self.operation["summary"] + "."
        return text.replace("\\", "\\\\").replace('"""', "'''")

    def has_text(self) -> bool:
        return len(self.answers) > 1 and "application/json" in self.answers

    def returned(self, kind: str) -> tuple[str, str]:
        """Returns the type of the result and the expression of what reads it."""
        if kind != "application/json":
            is_binary = kind in ("application/octet-stream", "image/png")
            return ("bytes", "bytes") if is_binary else ("str", "str")
        schema = self.answers[kind]
        if self.id == "create_submission":
            return "models.AcceptedBody", "models.AcceptedBody"
        if self.id == "get_stress":
            return "models.StressBody", "models.StressBody"
        if "$ref" in schema:
            name = "models." + schema["$ref"].rsplit("/", 1)[1]
            return name, name
        return ("str", "str") if schema.get("type") == "string" else ("dict[str, Any]", "ANY")


def write_resources(document: Schema, output: Path, is_async: bool) -> None:
    resources: dict[str, list[Method]] = {}
    for path, operations in document["paths"].items():
        for verb, operation in operations.items():
            if operation["operationId"] in BY_HAND:
                continue
            method = Method(document, verb, path, operation)
            resources.setdefault(method.resource, []).append(method)
    client = "AsyncCaller" if is_async else "Caller"
    prefix = "Async" if is_async else ""
    lines = [
        HEADER.format(about="Resources of the " + ("asynchronous" if is_async else "blocking") + " client."),
        "# ruff: noqa\n# fmt: off\nfrom __future__ import annotations\n",
        "from collections.abc import Mapping, Sequence\nfrom typing import Any, Literal\nfrom uuid import UUID\n",
        f"from . import models\nfrom .calls import ANY, {client}, given, new_key, quoted\n",
    ]
    for resource, methods in sorted(resources.items()):
        title = prefix + "".join(word.capitalize() for word in resource.split("_"))
        lines.append(f'\nclass {title}:\n    """`client.{resource}`."""\n')
        lines.append(f"    def __init__(self, client: {client}) -> None:\n        self._client = client\n")
        lines += [method.write(is_async) for method in sorted(methods, key=lambda method: method.name)]
    output.write_text("\n".join(lines))


def main() -> None:
    document = json.loads(Path(sys.argv[1]).read_text())
    folder = Path(sys.argv[2])
    write_models(document, folder / "models.py")
    write_resources(document, folder / "resources.py", is_async=False)
    write_resources(document, folder / "async_resources.py", is_async=True)


main()
