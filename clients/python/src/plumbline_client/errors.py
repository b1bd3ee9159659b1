"""Errors of the client: what the service answers, and what keeps it from answering."""

from __future__ import annotations

from .models import FaultBody, Problem


class PlumblineError(Exception):
    """Base of all errors of this package."""


class NotReached(PlumblineError):
    """The service could not be reached, or the connection broke, also after all retries."""


class TimedOut(PlumblineError):
    """What was waited for did not happen in time."""


class GradingFailed(PlumblineError):
    """A run waits for grades that the service failed to make, and that its operator can have made."""


class UnreadableAnswer(PlumblineError):
    """The service answered with something that this version of the client cannot read."""


class Unwritable(PlumblineError):
    """What is to be sent cannot be written as JSON, for example an object of a class of its own."""


class ApiError(PlumblineError):
    """The service answered with a problem (RFC 9457).

    `kind` is the stable name of the problem, such as `invalid-body`; `faults` lists what is wrong with the request, each
    with its JSON pointer.
    """

    def __init__(self, problem: Problem, retry_after_s: float | None = None) -> None:
        super().__init__(problem)
        self.problem = problem
        self.retry_after_s = retry_after_s

    @property
    def status(self) -> int:
        """HTTP status."""
        return self.problem.status

    @property
    def kind(self) -> str:
        """Stable name of the problem."""
        return self.problem.type.rsplit(":", 1)[-1]

    @property
    def detail(self) -> str:
        """What happened, for people."""
        return self.problem.detail

    @property
    def faults(self) -> list[FaultBody]:
        """What is wrong with the request."""
        return self.problem.faults or []

    @property
    def is_retryable(self) -> bool:
        """Whether the same request may succeed later."""
        return bool(self.problem.retryable) or self.kind == "idempotency-in-flight"

    def __str__(self) -> str:
        lines = [f"{self.status} {self.kind}: {self.detail}"]
        for fault in self.faults:
            place = fault.pointer or (f"parameter {fault.parameter}" if fault.parameter else "body")
            line = f"line {fault.line}, " if fault.line else ""
            lines.append(f"  {line}{place}: {fault.detail}")
        return "\n".join(lines)


class BadRequest(ApiError):
    """400: the request cannot be read."""


class Unauthorized(ApiError):
    """401: there is no key, or none that is live."""


class Forbidden(ApiError):
    """403: the key does not allow this."""


class NotFound(ApiError):
    """404: nothing has this name."""


class Conflict(ApiError):
    """409: the request does not fit the current state; `kind` says why."""


class TooLarge(ApiError):
    """413: the body is larger than the service takes."""


class Faulty(ApiError):
    """422: the request has `faults`."""


class TooMany(ApiError):
    """429: too many requests, also after all retries."""


class ServiceFailed(ApiError):
    """5xx: the service failed or is busy, also after all retries."""


BY_STATUS: dict[int, type[ApiError]] = {
    400: BadRequest,
    401: Unauthorized,
    403: Forbidden,
    404: NotFound,
    409: Conflict,
    413: TooLarge,
    422: Faulty,
    429: TooMany,
}


NOT_REACHED = "urn:plumbline-client:not-reached"
"""Type of the problem that stands for a service that does not answer, where a result has room for a problem only."""


def of_problem(problem: Problem, retry_after_s: float | None = None) -> PlumblineError:
    """Returns the error for a problem."""
    if problem.type == NOT_REACHED:
        return NotReached(problem.detail)
    default = ServiceFailed if problem.status >= 500 else ApiError
    return BY_STATUS.get(problem.status, default)(problem, retry_after_s)
