# SPDX-License-Identifier: MIT OR Apache-2.0
"""The program as a child process: progress, cancelling, errors."""

import json
import queue
import subprocess
import threading


class Run:
    """A run of the recipe of a job. The program's messages are read on a thread, so that it never waits."""

    def __init__(self, program, job):
        command = [program, "run", job.recipe, "--progress=json"]
        if job.frames is not None:
            command += ["--frames", f"{job.frames[0]}-{job.frames[-1]}"]
        try:
            self._process = subprocess.Popen(
                command, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
            )
        except OSError as error:
            message = f"cannot start {program!r}: {error.strerror}; set its path in the add-on's preferences"
            raise OSError(message) from error
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
                self._share = (entry.get("percent") or 0.0) / 100.0
            elif line.startswith("frame "):
                self._frame += 1
            else:
                self._messages.append(line.rstrip())

    def progress(self):
        """The share of the work that is done, 0 to 1."""
        self._update()
        return min((max(self._frame - 1, 0) + self._share) / self._frames, 1.0)

    def stage(self):
        """What the program is doing."""
        if self._frames > 1:
            return f"frame {self._frame} of {self._frames}, {self._stage}"
        return self._stage

    def is_done(self):
        self._update()
        return self._process.poll() is not None

    def wait(self):
        self._process.wait()

    def cancel(self):
        """Stops the program as Ctrl-C does; it leaves nothing half-written."""
        self._process.terminate()
        self._process.wait()

    def error(self):
        """The program's error, or nothing."""
        if self._process.wait() == 0:
            return None
        self._reader.join()
        self._update()
        start = next((n for n, line in enumerate(self._messages) if line.startswith("error")), 0)
        return "\n".join(self._messages[start:]) or f"druse ended with exit code {self._process.returncode}"
