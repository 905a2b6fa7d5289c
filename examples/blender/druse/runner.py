# SPDX-License-Identifier: MIT OR Apache-2.0
"""The program as a child process: progress, cancelling, errors and warnings."""

import atexit
import json
import os
import queue
import subprocess
import threading
import time

# The stage that takes longest, and the share of a frame's work given to it.
MAIN_STAGE, MAIN_SHARE = "band", 0.7


class Run:
    """A run of the recipe of a job. The program's messages are read on a thread, so that it never waits."""

    def __init__(self, program, job):
        command = [program, "run", job.recipe, "--progress=json"]
        if job.frames is not None:
            command += ["--frames", f"{job.frames[0]}-{job.frames[-1]}"]
        # On Windows no console opens.
        flags = subprocess.CREATE_NO_WINDOW if os.name == "nt" else 0
        try:
            self._process = subprocess.Popen(
                command,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.PIPE,
                encoding="utf-8",
                errors="replace",
                creationflags=flags,
            )
        except OSError as error:
            message = f"cannot start {program!r}: {error.strerror}; set its path in the add-on's preferences"
            raise OSError(message) from error
        # Blender may quit meanwhile.
        atexit.register(self._process.terminate)
        self._start = time.monotonic()
        self._frames = len(job.frames or [0])
        self._lines = queue.Queue()
        self._messages = []
        self._stage = "starting"
        self._share = 0.0
        self._frame = 0
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self):
        for line in self._process.stderr:
            self._lines.put(line)

    def _update(self):
        while True:
            try:
                line = self._lines.get_nowait()
            except queue.Empty:
                return
            try:
                entry = json.loads(line)
            except ValueError:
                entry = None
            if isinstance(entry, dict) and "stage" in entry:
                self._stage = str(entry["stage"])
                if self._stage == MAIN_STAGE:
                    # Stages have percents of their own; what is shown never runs backwards.
                    share = (entry.get("percent") or 0.0) / 100.0
                    self._share = max(self._share, share * MAIN_SHARE)
            elif line.startswith("frame "):
                self._frame += 1
                self._share = 0.0
            else:
                self._messages.append(line.rstrip())

    def progress(self):
        """The share of the work that is done, 0 to 1; never less than before."""
        self._update()
        return min((max(self._frame - 1, 0) + self._share) / self._frames, 1.0)

    def stage(self):
        """What the program is doing, and for how long it has run."""
        frame = f"frame {self._frame} of {self._frames}, " if self._frames > 1 else ""
        return f"{frame}{self._stage}, {time.monotonic() - self._start:.0f} s"

    def is_done(self):
        self._update()
        return self._process.poll() is not None

    def wait(self):
        self._process.wait()
        atexit.unregister(self._process.terminate)

    def cancel(self):
        """Ends the program; files that it has not finished are not there under their names."""
        self._process.terminate()
        try:
            self._process.wait(timeout=10.0)
        except subprocess.TimeoutExpired:
            self._process.kill()
        self.wait()

    def _all(self):
        self.wait()
        self._reader.join()
        self._update()

    def error(self):
        """The program's error, or nothing."""
        self._all()
        if self._process.returncode == 0:
            return None
        start = next((n for n, line in enumerate(self._messages) if line.startswith("error")), 0)
        return "\n".join(self._messages[start:]) or f"druse ended with exit code {self._process.returncode}"

    def warnings(self):
        """The program's warnings, the first of each kind."""
        self._all()
        found = {}
        for line in self._messages:
            if line.startswith("warning["):
                found.setdefault(line.split("]")[0], line)
        return list(found.values())
