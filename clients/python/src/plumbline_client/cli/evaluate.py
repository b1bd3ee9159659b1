"""`plumbline-client evaluate`."""

from __future__ import annotations

import argparse
import asyncio
import json
import os
import re
import sys
from pathlib import Path
from typing import Any

from tqdm import tqdm

from ..async_client import AsyncClient
from ..calls import Retries
from ..errors import NotReached, PlumblineError
from ..evaluate import Outcome, Plan, evaluate
from ..evaluate.model import Model
from ..evaluate.plan import Budget, Prices, Sampling

EPILOG = """\
example:
  plumbline-client evaluate --model qwen3-coder --base-url http://localhost:8000/v1 --suite mineceraft-lite

Exit codes: 0 if all runs are finished; 3 if the evaluation stopped early or some problems have no answer (run the same
command again to resume); 1 if it could not start."""


def add_to(commands: Any) -> None:
    """Adds the command to the parser."""
    parser: argparse.ArgumentParser = commands.add_parser(
        "evaluate",
        help="evaluate a model: ask it for every task, submit its answers, and finish the run",
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.set_defaults(run=run)
    model = parser.add_argument_group("model")
    model.add_argument("--model", required=True, metavar="NAME", help="name of the model, as the endpoint knows it")
    model.add_argument(
        "--base-url",
        default=os.environ.get("OPENAI_BASE_URL") or "https://api.openai.com/v1",
        metavar="URL",
        help="endpoint with OpenAI's Chat Completions; by default $OPENAI_BASE_URL, or OpenAI's own",
    )
    model.add_argument(
        "--model-key-env", metavar="NAME", help="variable that holds the endpoint's key (OPENAI_API_KEY)"
    )
    model.add_argument("--request-timeout", type=positive, default=600.0, metavar="S", help="of one request (600)")
    model.add_argument(
        "--patience", type=positive, default=900.0, metavar="S", help="for all tries of one answer (900)"
    )
    sampling = parser.add_argument_group("sampling; what is not given is left to the endpoint")
    sampling.add_argument("--temperature", type=float)
    sampling.add_argument("--top-p", type=float)
    sampling.add_argument("--max-tokens", type=whole, help="most tokens of one answer")
    sampling.add_argument("--reasoning-effort", metavar="LEVEL")
    sampling.add_argument("--seed", type=int, help="seed of the first run; each further run has the next")
    sampling.add_argument("--extra", type=an_object, default={}, metavar="JSON", help="other members of each request")
    what = parser.add_argument_group("what is evaluated")
    what.add_argument("--suite", help="name, or name@version (mineceraft)")
    what.add_argument("--epoch", help="hidden evaluation in this epoch, in place of a suite")
    what.add_argument("--tier", choices=["dev", "official"], help="tier of the entry (dev)")
    what.add_argument("--track", choices=["specified", "brief"], help="track of prompts (specified)")
    what.add_argument(
        "--task",
        action="append",
        default=[],
        dest="tasks",
        metavar="TASK",
        help="only this task, by its id or number, repeatable; to resume, name it the same way; the run then stays open",
    )
    what.add_argument("--repeat", type=whole, default=1, metavar="N", help="number of runs (1)")
    how = parser.add_argument_group("how")
    how.add_argument("--agent", help="name on the board; by default the model's")
    how.add_argument(
        "--mode", choices=["one-shot", "episodes"], default="one-shot", help="one answer a turn, or steps with feedback"
    )
    how.add_argument("--steps", type=whole, metavar="N", help="most answers a turn of an episode (4)")
    how.add_argument("--pictures", action="store_true", help="show the build after each step of an episode")
    how.add_argument(
        "--profile", choices=["mindcraft", "published"], default="mindcraft", help="rules for code (mindcraft)"
    )
    how.add_argument("--system", type=Path, metavar="FILE", help="system prompt; by default the service's guide")
    how.add_argument("--concurrency", type=whole, default=8, metavar="N", help="problems at a time (8)")
    how.add_argument("--folder", type=Path, help="journal and transcripts; by default plumbline-runs/ and a name")
    how.add_argument(
        "--skip-failed", action="store_true", help="finish runs also if the model gave no answer to some problems"
    )
    budget = parser.add_argument_group("budget and cost; prices are for a million tokens")
    budget.add_argument("--max-requests", type=whole)
    budget.add_argument("--max-total-tokens", type=whole)
    budget.add_argument("--max-cost", type=positive)
    budget.add_argument("--price-input", type=positive)
    budget.add_argument("--price-output", type=positive)
    budget.add_argument("--price-cached-input", type=positive)
    budget.add_argument("--currency", default="USD")
    budget.add_argument("--prices-as-of", metavar="YYYY-MM-DD", type=a_date)


def run(given: argparse.Namespace) -> int:
    """Runs the command."""
    plan, prices = plan_of(given), prices_of(given)
    refuse_contradictions(given)
    if given.max_cost is not None and prices is None:
        raise PlumblineError("--max-cost needs --price-input, --price-output and --prices-as-of")
    folder = given.folder or Path("plumbline-runs") / folder_name(plan)
    budget = Budget(given.max_requests, given.max_total_tokens, given.max_cost)
    print(f"journal and transcripts: {folder}", file=sys.stderr)
    outcome = asyncio.run(carried_out(given, plan, prices, folder, budget))
    tell(outcome, folder)
    try:
        (folder / "outcome.json").write_text(json.dumps(as_json(outcome), indent=1))
    except OSError as error:
        raise PlumblineError(f"outcome.json cannot be written: {error.strerror}") from error
    return 0 if outcome.is_complete else 3


async def carried_out(
    given: argparse.Namespace, plan: Plan, prices: Prices | None, folder: Path, budget: Budget
) -> Outcome:
    key = os.environ.get(given.model_key_env or "OPENAI_API_KEY")
    model = Model(
        plan.model,
        given.base_url,
        key,
        plan.sampling,
        timeout_s=given.request_timeout,
        patience_s=given.patience,
    )
    with tqdm(unit=" problems", mininterval=1.0) as bar:

        def show(done: int, of: int) -> None:
            bar.total = of
            bar.update(done - bar.n)

        try:
            await tell_if_away(given)
            async with AsyncClient(given.server, given.key) as client:
                return await evaluate(
                    plan,
                    client,
                    model,
                    folder,
                    budget=budget,
                    prices=prices,
                    concurrency=given.concurrency,
                    skip_failed=given.skip_failed,
                    progress=show,
                )
        finally:
            await model.close()


async def tell_if_away(given: argparse.Namespace) -> None:
    """Says at once that the service does not answer; the first request is then tried for a while."""
    async with AsyncClient(given.server, given.key, retries=Retries(most=0), timeout_s=10.0) as client:
        try:
            await client.service.health()
        except NotReached as error:
            print(f"{error}; trying again for up to two minutes", file=sys.stderr)
        except PlumblineError:
            # What is wrong shows with the first request.
            pass


def refuse_contradictions(given: argparse.Namespace) -> None:
    """Refuses options that would do nothing, or not what they say."""
    if given.mode == "episodes" and given.profile == "published":
        raise PlumblineError("episodes have the rules of mindcraft; leave --profile published out")
    if given.epoch is not None and (given.tasks or given.suite is not None or given.track is not None):
        raise PlumblineError("an epoch has neither suites, nor tasks to choose, nor tracks; leave those options out")
    if given.epoch is None and given.tier is not None:
        raise PlumblineError("--tier is of a hidden evaluation; name its --epoch")
    if given.mode != "episodes" and (given.pictures or given.steps is not None):
        raise PlumblineError("--pictures and --steps are of --mode episodes")
    own = {"model", "messages", "temperature", "top_p", "max_tokens", "reasoning_effort", "seed", "stream"}
    if own & given.extra.keys():
        raise PlumblineError(f"--extra has {', '.join(sorted(own & given.extra.keys()))}; use the option for it")
    if not given.model.strip():
        raise PlumblineError("--model is empty")
    has_key = bool(os.environ.get(given.model_key_env or "OPENAI_API_KEY"))
    if not has_key and (given.model_key_env is not None or "api.openai.com" in given.base_url):
        raise PlumblineError(f"no key for the endpoint: {given.model_key_env or 'OPENAI_API_KEY'} is empty; set it")


def plan_of(given: argparse.Namespace) -> Plan:
    system = None
    if given.system is not None:
        try:
            system = given.system.read_text(encoding="utf-8")
        except (OSError, UnicodeDecodeError) as error:
            raise PlumblineError(f"--system {given.system}: {error}") from error
    return Plan(
        model=given.model,
        agent=given.agent or given.model,
        suite=given.suite or "mineceraft",
        epoch=given.epoch,
        tier=given.tier or "dev",
        track=given.track or "specified",
        profile=given.profile,
        mode=given.mode,
        steps=given.steps or 4,
        pictures=given.pictures,
        repeat=given.repeat,
        tasks=tuple(given.tasks),
        system=system,
        sampling=Sampling(
            temperature=given.temperature,
            top_p=given.top_p,
            max_tokens=given.max_tokens,
            reasoning_effort=given.reasoning_effort,
            seed=given.seed,
            extra=given.extra,
        ),
    )


def prices_of(given: argparse.Namespace) -> Prices | None:
    needed = (given.price_input, given.price_output, given.prices_as_of)
    if all(part is None for part in needed):
        return None
    if any(part is None for part in needed):
        raise PlumblineError("prices need --price-input, --price-output and --prices-as-of")
    return Prices(given.price_input, given.price_output, given.currency, given.prices_as_of, given.price_cached_input)


def folder_name(plan: Plan) -> str:
    """Returns the name of the folder of a plan: the same command finds its journal again."""
    label = re.sub(r"[^A-Za-z0-9.@_-]+", "-", f"{plan.agent[:60]}-{plan.epoch or plan.suite}").strip("-")
    return f"{label}-{plan.sha256()[:8]}"


def tell(outcome: Outcome, folder: Path) -> None:
    """Prints what became of the evaluation."""
    for run in outcome.finished:
        passed = len(run.summary.passed_runs.overall) if run.summary is not None else 0
        print(f"run {run.id} is finished: {passed} of {run.tasks} problems pass; {outcome.url}/runs/{run.id}")
    for open_run in outcome.left_open:
        print(f"run {open_run} has answers to the tasks given by --task and stays open for the rest")
        print(f"builds and scores, as they are graded: {outcome.url}/runs/{open_run}")
    if outcome.entry is not None:
        print(f"entry {outcome.entry['id']} is finalized")
        result = outcome.entry.get("result")
        place = f"GET /v1/entries/{outcome.entry['id']}"
        print(
            f"result: {json.dumps(result)}"
            if result
            else f"{place} has the result once it is released; run the same command again to see it"
        )
    odd = {"refused": "refused", "tool_calls": "with calls of tools", "cut_off": "cut off", "empty": "empty"}
    odd_ones = [f"{outcome.answers[name]} {words}" for name, words in odd.items() if outcome.answers.get(name)]
    if odd_ones:
        print(f"of {outcome.answers['answers']} answers: {', '.join(odd_ones)}")
    of_code = {
        "code_failed": "failed before they built anything",
        "code_idle": "ended without building anything (GET /v1/submissions/ID says why)",
        "code_stopped": "reached a limit and count as empty",
    }
    for name, words in of_code.items():
        if count := outcome.answers.get(name):
            print(f"turns whose answers {words}: {count}")
    spending = outcome.spending.as_json()
    tokens = (
        f"{spending['input_tokens']} + {spending['output_tokens']}"
        if spending["input_tokens"] is not None
        else "unknown"
    )
    cost = f"{spending['cost']} {spending['currency']}" if spending["cost"] is not None else "unknown"
    print(f"requests: {spending['requests']}; tokens: {tokens}; cost: {cost}; transcripts and journal: {folder}")
    own = {
        name: why for name, why in outcome.failed.items() if why != outcome.stopped and not why.startswith("not begun")
    }
    for name, reason in list(own.items())[:10]:
        run_number, _, problem = name.partition("/")
        print(f"no answer to {problem} in run {run_number}: {reason}", file=sys.stderr)
    if outcome.failed:
        print(f"problems without an answer: {len(outcome.failed)} of {outcome.problems}", file=sys.stderr)
    if outcome.stopped is not None:
        print(f"stopped: {outcome.stopped}", file=sys.stderr)
    if not outcome.is_complete:
        hint = "" if outcome.stopped else ", or add --skip-failed to finish without the missing answers"
        print(f"run the same command again to resume{hint}", file=sys.stderr)


def as_json(outcome: Outcome) -> dict[str, Any]:
    return {
        "entry" if outcome.entry is not None else "runs": outcome.runs[0]
        if outcome.entry is not None
        else outcome.runs,
        "complete": outcome.is_complete,
        "stopped": outcome.stopped,
        "failed": outcome.failed,
        "answers": outcome.answers,
        "spending": outcome.spending.as_json(),
    }


def whole(text: str) -> int:
    """Reads a number from 1."""
    number = int(text)
    if number < 1:
        raise argparse.ArgumentTypeError("expected a number from 1")
    return number


def positive(text: str) -> float:
    """Reads a number from 0."""
    number = float(text)
    if not 0.0 <= number < float("inf"):
        raise argparse.ArgumentTypeError("expected a number from 0")
    return number


def a_date(text: str) -> str:
    """Reads a date."""
    if not re.fullmatch(r"\d{4}-\d{2}-\d{2}", text):
        raise argparse.ArgumentTypeError("expected a date as YYYY-MM-DD")
    return text


def an_object(text: str) -> dict[str, Any]:
    """Reads an object."""
    try:
        found = json.loads(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(f"not JSON: {error}") from error
    if not isinstance(found, dict):
        raise argparse.ArgumentTypeError("expected an object")
    return found
