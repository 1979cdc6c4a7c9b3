"""Commands that a page has started: each runs as a process of its own, so that it can be cancelled."""

import contextlib
import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from hysteresis import InputError
from hysteresis._escape import shell_word

PATIENCE = 3.0
"""Seconds in which a cancelled command may end by itself."""
KEPT = 40
"""Finished jobs that are remembered."""
LINES = 200
"""Lines of a job's log that are kept."""
SHOWN = ("file", "files", "notes", "verdict", "flagged", "rows")
"""Entries of a command's result that pages are sent."""
SOURCES = Path(__file__).resolve().parents[2]


@dataclass
class Job:
    """A command, how far it is, and what came of it.

    - `subject`: the measurement or fit it is about; `kind`: the command's name; `options`: what the page
      asked for, such as the file that a compensator is tried on.
    - `state`: running, done, failed or cancelled.
    - `result`: the JSON object that the command printed; `error`: why it failed, as the command says it.
    """

    number: int
    kind: str
    subject: str
    words: list[str]
    process: subprocess.Popen[str]
    options: dict[str, Any]
    begin: float = field(default_factory=time.monotonic)
    end: float | None = None
    since: float | None = None
    said: list[str] = field(default_factory=list)
    done: int = 0
    total: int = 0
    state: str = "running"
    result: Any = None
    error: dict[str, Any] | None = None
    cancelled: bool = False

    @property
    def left(self) -> float | None:
        """Seconds left, if the parts to come take as long as those done; None where that is not known."""
        if self.state != "running" or self.since is None or not 0 < self.done < self.total:
            return None
        spent = time.monotonic() - self.since
        return spent * (self.total - self.done) / self.done

    @property
    def document(self) -> dict[str, Any]:
        """Plain data for a page."""
        same = ("number", "kind", "subject", "options", "state", "done", "total", "left", "error")
        # The rest of the result is in the files that the command has written.
        known = self.result if isinstance(self.result, dict) else None
        return {name: getattr(self, name) for name in same} | {
            "command": " ".join(["hysid", *map(shell_word, self.words)]),
            "said": self.said[-8:],
            "seconds": (self.end or time.monotonic()) - self.begin,
            "result": None if known is None else {k: known[k] for k in SHOWN if k in known},
        }

    def hear(self, line: str) -> None:
        """Take a line that the command has logged."""
        entry = None
        with contextlib.suppress(ValueError):
            entry = json.loads(line)
        entry = entry if isinstance(entry, dict) else {"said": line}
        fault = entry.get("error")
        if isinstance(fault, dict):
            self.error = fault
            return
        self.since = self.since or time.monotonic()
        self.said = [*self.said, str(entry.get("said", ""))][-LINES:]
        if "total" in entry:
            self.done, self.total = int(entry["done"]), int(entry["total"])


class Jobs:
    """The commands of one folder. `version` grows with each change, so that pages know when to look."""

    def __init__(self, root: Path):
        self._root = root
        self._lock = threading.Lock()
        self._jobs: list[Job] = []
        self.version = 0

    def start(
        self,
        kind: str,
        subject: str,
        words: Sequence[str],
        options: Mapping[str, Any] | None = None,
    ) -> Job:
        """Run `hysid WORDS --json` in the folder.

        Raises `InputError` `would-overwrite` while another command about the same subject runs.
        """
        # A command whose results are seen already takes a moment to end.
        until = time.monotonic() + PATIENCE
        while self._busy(subject) and time.monotonic() < until:
            time.sleep(0.05)
        with self._lock:
            if self._busy(subject):
                raise InputError(
                    "would-overwrite", "A command on this file is running.", place=subject,
                    fix="Wait until it ends, or cancel it.",
                )  # fmt: skip
            number = 1 + max((job.number for job in self._jobs), default=0)
            options = {key: str(value) for key, value in (options or {}).items()}
            job = Job(number, kind, subject, list(words), self._process(words), options)
            self._jobs = [*self._jobs, job][-KEPT:]
            self.version += 1
        threading.Thread(target=self._follow, args=(job,), daemon=True).start()
        return job

    def _busy(self, subject: str) -> bool:
        return any(job.subject == subject and job.state == "running" for job in self._jobs)

    def listed(self) -> list[dict[str, Any]]:
        """All jobs, the oldest first."""
        with self._lock:
            return [job.document for job in self._jobs]

    def cancel(self, number: int) -> None:
        """Interrupt a command, as Ctrl-C does; a command that goes on is ended."""
        with self._lock:
            found = [job for job in self._jobs if job.number == number and job.state == "running"]
        for job in found:
            job.cancelled = True
            _end(job.process)

    def close(self) -> None:
        """End all that run."""
        with self._lock:
            running = [job for job in self._jobs if job.state == "running"]
        for job in running:
            self.cancel(job.number)
        for job in running:
            try:
                job.process.wait(PATIENCE)
            except subprocess.TimeoutExpired:
                job.process.kill()

    def touched(self) -> None:
        """Tell pages that something in the folder has changed."""
        with self._lock:
            self.version += 1

    def _process(self, words: Sequence[str]) -> subprocess.Popen[str]:
        # The packages of this process, and nothing of the folder, whose files anybody may have written: -P.
        path = os.pathsep.join(filter(None, [str(SOURCES), os.environ.get("PYTHONPATH", "")]))
        return subprocess.Popen(
            [sys.executable, "-P", "-m", "hysid", *words, "--json"],
            cwd=self._root,
            env=os.environ | {"HYSID_LOG": "json", "PYTHONPATH": path, "PYTHONIOENCODING": "utf-8"},
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            encoding="utf-8",
            errors="replace",
            start_new_session=os.name == "posix",
        )

    def _follow(self, job: Job) -> None:
        printed, logged = job.process.stdout, job.process.stderr
        assert printed is not None
        assert logged is not None
        whole: list[str] = []
        reader = threading.Thread(target=lambda: whole.append(printed.read()), daemon=True)
        reader.start()
        for line in logged:
            job.hear(line.rstrip("\n"))
        reader.join()
        printed.close()
        logged.close()
        status = job.process.wait()
        with self._lock:
            job.end = time.monotonic()
            try:
                job.result = json.loads(whole[0]) if whole and whole[0].strip() else None
            except ValueError:
                job.error = {"code": "bug", "message": whole[0][-500:]}
            # A verdict of FAIL has a result and an exit status of its own.
            good = job.result is not None and job.error is None
            job.state = "done" if good else "cancelled" if job.cancelled else "failed"
            if job.state == "failed" and job.error is None:
                said = " ".join(job.said[-3:]) or f"The command ended with status {status}."
                job.error = {"code": "ended", "message": said}
            self.version += 1


def _end(process: subprocess.Popen[str]) -> None:
    with contextlib.suppress(ProcessLookupError):
        if os.name == "posix":
            os.killpg(process.pid, signal.SIGINT)
        else:
            process.terminate()
        later = threading.Timer(PATIENCE, process.kill)  # which does nothing after its end
        later.daemon = True
        later.start()
