"""The way of a lab, with the generated client: arguments are its folder, the address of the service, and a good build."""

import importlib
import json
import pkgutil
import sys
import time

sys.path.insert(0, sys.argv[1])

import plumbline_client
from plumbline_client import Client
from plumbline_client.api.leaderboards import get_leaderboard
from plumbline_client.api.rewards import grade
from plumbline_client.api.runs import create_run, finish_run, get_run, list_runs
from plumbline_client.api.submissions import create_submission, get_log, get_report, get_submission, validate_submission
from plumbline_client.models import AcceptedBody, FinishBody, NewGrade, NewRunBody, NewSubmissionBody, RunBody, SkipAll

# The generator leaves modules that cannot be imported without a word.
for module in pkgutil.walk_packages(plumbline_client.__path__, "plumbline_client."):
    importlib.import_module(module.name)


def until(ends, look):
    for _ in range(300):
        found = look()
        if str(found.state) in ends:
            return found
        time.sleep(0.1)
    raise AssertionError(f"still {found.state}")


built = json.load(open(sys.argv[3]))
with Client(base_url=sys.argv[2], raise_on_unexpected_status=True) as client:
    new = NewRunBody(agent="generated client", suite="mineceraft")
    run = create_run.sync(client=client, body=new, idempotency_key="once")
    assert isinstance(run, RunBody), run
    assert create_run.sync(client=client, body=new, idempotency_key="once").id == run.id
    body = NewSubmissionBody.from_dict({**built, "run": str(run.id)})
    assert validate_submission.sync(client=client, body=body).submissions[0].turns == len(built["turns"])
    accepted = create_submission.sync(client=client, body=body)
    assert isinstance(accepted, AcceptedBody), accepted
    submission = until(("graded",), lambda: get_submission.sync(id=accepted.id, client=client))
    assert submission.overall is True, submission
    report = get_report.sync(id=accepted.id, client=client)
    assert report.overall and report.turns[0].checks[0].score == 1.0, report
    stored = get_log.sync(id=accepted.id, client=client)
    again = NewGrade.from_dict({"task": built["task"], "log": stored.to_dict(), "reward": "shaped"})
    assert grade.sync(client=client, body=again).reward == 1.0
    finish = FinishBody(skip=SkipAll.UNANSWERED)
    finish_run.sync(id=run.id, client=client, body=finish)
    done = until(("finished",), lambda: get_run.sync(id=run.id, client=client))
    assert done.skipped == done.tasks - 1, done
    assert [own.id for own in list_runs.sync(client=client).runs] == [run.id]
    board = get_leaderboard.sync(client=client, suite="mineceraft")
    assert board.rows[0].agent == "generated client" and board.rows[0].run == run.id, board
print("ok")
