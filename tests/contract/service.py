"""Starts a real `ropescope serve` on a fresh data folder and talks to it with nothing but the standard library."""

import json
import os
import re
import signal
import subprocess
import time
import urllib.error
import urllib.request


class Service:
    """One running service; `with Service(binary, folder) as service:`."""

    def __init__(self, binary, folder):
        self.binary = str(binary)
        self.folder = folder
        self.data = folder / "data"
        self.token = self.new_token("admin")
        self.log = open(folder / "serve.log", "wb")
        self.process = subprocess.Popen(
            # How much room the machine's disk has is not what is tested: a full one has tests of its own.
            [self.binary, "serve", "--data", self.data, "--listen", "127.0.0.1:0", "--reserve-mb", "10"],
            stdout=subprocess.PIPE,
            stderr=self.log,
        )
        line = self.process.stdout.readline().decode()
        found = re.search(r"http://\S+", line)
        if not found:
            raise RuntimeError(f"the service did not say where it listens, but {line!r}")
        self.url = found.group(0)

    def new_token(self, role):
        """A token of a role, made on the command line."""
        made = subprocess.run(
            [self.binary, "token", "create", "--role", role, "--data", self.data],
            check=True, capture_output=True, text=True,
        )
        return made.stdout.strip().splitlines()[-1]

    def call(self, method, path, body=None, headers=None, raw=None):
        """Status and decoded body of a request to /api/v1."""
        data = raw if raw is not None else None if body is None else json.dumps(body).encode()
        headers = {"Authorization": f"Bearer {self.token}", **(headers or {})}
        if body is not None:
            headers["Content-Type"] = "application/json"
        request = urllib.request.Request(f"{self.url}/api/v1{path}", data, headers, method=method)
        try:
            with urllib.request.urlopen(request, timeout=60) as answer:
                status, content = answer.status, answer.read()
        except urllib.error.HTTPError as error:
            status, content = error.code, error.read()
        try:
            return status, json.loads(content)
        except ValueError:
            return status, content

    def want(self, method, path, body=None, **more):
        """Body of a request that has to succeed."""
        status, answer = self.call(method, path, body, **more)
        if not 200 <= status < 300:
            raise RuntimeError(f"{method} {path} answered {status}: {answer}")
        return answer

    def job(self, body, timeout_s=600):
        """Runs a job to its end."""
        job = self.want("POST", "/jobs", body)
        end = time.monotonic() + timeout_s
        while job["state"] in ("queued", "running"):
            if time.monotonic() > end:
                raise RuntimeError(f"the job did not end within {timeout_s} s: {job}")
            time.sleep(0.3)
            job = self.want("GET", f"/jobs/{job['id']}")
        return job

    def upload(self, folder, *more):
        """Uploads an acquisition folder with the command line client; returns its last line."""
        done = subprocess.run(
            [self.binary, "upload", folder, "--server", self.url, "--json", *more],
            check=True, capture_output=True, text=True, env={**os.environ, "ROPESCOPE_TOKEN": self.token},
        )
        return json.loads(done.stdout.strip().splitlines()[-1])

    def simulate(self, name, *options):
        """Simulates an acquisition; returns its folder."""
        out = self.folder / name
        subprocess.run([self.binary, "simulate", "--out", out, *options], check=True, capture_output=True)
        return out

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.process.send_signal(signal.SIGTERM)
        try:
            self.process.wait(60)
        except subprocess.TimeoutExpired:
            self.process.kill()
        self.log.close()
