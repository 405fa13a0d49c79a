"""One MAVProxy process, scripted by its standard input."""

import os
import queue
import re
import subprocess
import sys
import threading
import time
from pathlib import Path

MAVPROXY = Path(sys.executable).with_name("mavproxy.py")
MODULES = "cmdlong,param,arm,mode,wp,fence,rally,rc,log,ftp"


class Proxy:
    """MAVProxy on a vehicle that sends to a port of loopback, or on `master`; its words come line by line."""

    def __init__(self, port, folder, modules=MODULES, *, master=None):
        command = [
            sys.executable,
            str(MAVPROXY),
            f"--master={f'udpin:127.0.0.1:{port}' if master is None else master}",
            f"--state-basedir={folder}",
        ]
        command += [f"--logfile={folder}/flight.tlog", f"--default-modules={modules}"]
        self.process = subprocess.Popen(
            command,
            cwd=folder,
            env={**os.environ, "HOME": str(folder), "TERM": "dumb"},
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        self._lines = queue.Queue()
        self.heard = []
        self._reader = threading.Thread(target=self._read)
        self._reader.start()

    def _read(self):
        for line in self.process.stdout:
            self._lines.put(line.strip())

    def say(self, command):
        """Type a command."""
        self.process.stdin.write(command + "\n")
        self.process.stdin.flush()

    def expect(self, words, within_s=6.0):
        """Wait for a line with these words."""
        return self._match(re.escape(words), within_s).string

    def expect_number(self, pattern, within_s=6.0):
        """Wait for this pattern and read its group as a whole number; a prompt may stand before it in the line."""
        return int(self._match(pattern, within_s)[1])

    def hear(self, pattern, within_s=6.0):
        """Wait for this pattern and return its group; None if it does not come."""
        found = self._search(pattern, within_s)
        return None if found is None else found[1]

    def climbed(self, height_m, within_s=20.0):
        """Ask for the height above home until it is more than this; whether it ever was."""
        end_s = time.monotonic() + within_s
        while time.monotonic() < end_s:
            self.say("status GLOBAL_POSITION_INT")
            if self.expect_number(r"relative_alt : (-?\d+)") > height_m * 1e3:
                return True
            time.sleep(0.2)
        return False

    def heard_all(self):
        """Return every line that has come."""
        while not self._lines.empty():
            self.heard.append(self._lines.get())
        return self.heard

    def _match(self, pattern, within_s):
        found = self._search(pattern, within_s)
        assert found is not None, f"MAVProxy did not say {pattern!r}; it said {self.heard[-15:]}"
        return found

    def _search(self, pattern, within_s):
        end_s = time.monotonic() + within_s
        while time.monotonic() < end_s:
            try:
                line = self._lines.get(timeout=0.1)
            except queue.Empty:
                continue
            self.heard.append(line)
            if found := re.search(pattern, line):
                return found
        return None

    def close(self):
        """End it, as the end of its standard input does; may be called twice."""
        if self.process.stdin.closed:
            return
        self.process.stdin.close()
        try:
            self.process.wait(5.0)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
        self._reader.join()
        self.process.stdout.close()
