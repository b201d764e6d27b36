"""Holds a running service against its contract with programs that are not ours: schemathesis, standardwebhooks, tuspy and
tus-js-client (Node finds it over NODE_PATH); and walks through docs/upload.md with curl.

    python tests/contract/run.py target/debug/ropescope [--examples N] [--seed N]

Prints a line a check and, last, `N passed, N failed`; exit code 1 when a check failed.
"""

import argparse
import pathlib
import re
import subprocess
import sys
import tempfile

import tus
import walkthrough
import webhook
from seed import pins, seed
from service import Service

SCHEMATHESIS = pathlib.Path(sys.executable).with_name("schemathesis")

# A schema cannot say that a reference must exist, that wires must fit round a strand or that a cursor is one of ours:
# 422 (and 409 for states) is the documented answer to a body that is well formed and means nothing.
COMMON = """
[checks.positive_data_acceptance]
expected-statuses = ["2xx", "3xx", 401, 403, 404, 409, 415, 422]

# In alternatives the fuzzer takes the empty text for a UUID: JSON Schema lets `format` be ignored, the service does not.
[[operations]]
include-name = "POST /api/v1/jobs"
checks.positive_data_acceptance.expected-statuses = ["2xx", 400, 401, 403, 404, 409, 415, 422]

# It does not keep to the pattern of this header either.
[[operations]]
include-name = "PUT /api/v1/acquisitions/{id}/views/{view}/frames/{frame}"
checks.positive_data_acceptance.expected-statuses = ["2xx", "3xx", 400, 401, 403, 404, 409, 413, 415, 422]

[[operations]]
include-name = "PUT /api/v1/acquisitions/{id}/views/{view}/previews/{frame}"
checks.positive_data_acceptance.expected-statuses = ["2xx", "3xx", 400, 401, 403, 404, 409, 413, 415, 422]

# What is provisional goes when its job ends.
[[operations]]
include-path-regex = "^/api/v1/jobs/[^/]+/provisional-(lay-lengths|defects)$"
checks.positive_data_acceptance.expected-statuses = ["2xx", "3xx", 401, 403, 404, 409, 410, 415, 422]

# A range in metres or in lines, not both: parameters cannot exclude each other in a schema.
[[operations]]
include-path-regex = "^/api/v1/inspections/[^/]+/(views/[^/]+/(image|likelihood)[.]png|lay-lengths|line-scores)$"
checks.positive_data_acceptance.expected-statuses = ["2xx", "3xx", 400, 401, 403, 404, 409, 415, 422]
"""

# A job without a model has `model_id` null; following that to the model, the fuzzer writes `None` where the id belongs. Where ids
# are pinned this cannot happen, and there 400 is a finding.
FOLLOWED = """
[[operations]]
include-path-regex = "^/api/v1/models/"
checks.positive_data_acceptance.expected-statuses = ["2xx", "3xx", 400, 401, 403, 404, 409, 415, 422]
"""


class Tally:
    def __init__(self):
        self.passed, self.failed = 0, 0

    def check(self, name, ok, seen=""):
        self.passed, self.failed = self.passed + bool(ok), self.failed + (not ok)
        print(f"{'ok    ' if ok else 'FAILED'} {name}" + ("" if ok else f": {seen}"), flush=True)


def fuzz(tally, name, service, token, config, options):
    """One run of schemathesis: every operation it tested is a check."""
    path = service.folder / f"{re.sub('[^a-z]+', '-', name)}.toml"
    path.write_text(COMMON + config)
    done = subprocess.run(
        [SCHEMATHESIS, "--config-file", path, "run", f"{service.url}/openapi.json", "--header", f"Authorization: Bearer {token}",
         "--checks", "all", "--continue-on-failure", "--workers", "1", "--request-timeout", "30", "--no-color", *options],
        stdin=subprocess.DEVNULL, capture_output=True, text=True, cwd=service.folder,
    )
    tested = int((re.search(r"Tested: (\d+)", done.stdout) or [0, 0])[1])
    failing = set(re.findall(r"^_{3,} (.+?) _{3,}$", done.stdout, re.M))
    cases = (re.search(r"(\d+) generated", done.stdout) or [0, "0"])[1]
    for operation in sorted(failing):
        tally.check(f"{name}: {operation}", False, "see below")
    tally.passed += max(tested - len(failing), 0)
    print(f"{name}: {tested} operations, {cases} cases, {len(failing)} operations with findings", flush=True)
    if done.returncode and not failing:
        tally.check(f"{name}: the fuzzer runs", False, f"exit code {done.returncode}")
    if done.returncode:
        print(done.stdout[-30000:], done.stderr[-3000:], flush=True)
    if not tested:
        tally.check(f"{name}: something was tested", False, done.stderr[-500:])


def pinned(ids):
    """Configuration that sends every request to resources that exist."""
    blocks = []
    for prefix, value in pins(ids).items():
        blocks.append(
            f'[[operations]]\ninclude-path-regex = "^{re.escape(prefix).replace(chr(92), chr(92) * 2)}(/|$)"\n'
            f'parameters = {{ "path.id" = "{value}" }}\n'
        )
    return "\n".join(blocks)


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("binary", type=pathlib.Path)
    parser.add_argument("--examples", type=int, default=40)
    parser.add_argument("--seed", type=int, default=1)
    args = parser.parse_args()
    tally = Tally()
    bounded = ["--max-examples", str(args.examples), "--seed", str(args.seed)]
    with tempfile.TemporaryDirectory() as folder, Service(args.binary.resolve(), pathlib.Path(folder)) as service:
        ids, trouble = {}, ""
        try:
            seed(service, ids)
        except Exception as error:
            trouble = repr(error)
        tally.check("an acquisition is uploaded, learnt and inspected", not trouble, trouble)
        if "folder" in ids:
            for check in tus.checks(service, ids["rope"], ids["folder"]):
                tally.check(*check)
        if "model" in ids:
            for check in walkthrough.checks(service, ids):
                tally.check(*check)
        if "spare_defect" in ids:
            for check in webhook.checks(service, ids["spare_defect"]):
                tally.check(*check)
        else:
            tally.check("a defect to confirm was found", False, "webhooks could not be tried")
        # A quota that the fuzzer sets lets every upload be refused, so that comes late.
        # The token that fuzzes must not be revoked by the fuzzer: that operation comes last, with another token.
        revoke = "DELETE /api/v1/tokens/{id}"
        fuzz(tally, "resources that exist", service, service.token, pinned(ids),
             [*bounded, "--exclude-method", "DELETE", "--exclude-path-regex", "/storage$", "--phases", "examples,coverage,fuzzing", "--mode", "positive"])
        fuzz(tally, "anything at all", service, service.token, FOLLOWED,
             [*bounded, "--exclude-name", revoke, "--exclude-path-regex", "/storage$"])
        fuzz(tally, "storage of ropeways", service, service.token, pinned(ids), [*bounded, "--include-path-regex", "/storage$"])
        fuzz(tally, "revoking tokens", service, service.new_token("admin"), "", [*bounded, "--include-name", revoke])
        status, _ = service.call("GET", "/ropeways")
        tally.check("the service still answers", status == 200, str(status))
    print(f"{tally.passed} passed, {tally.failed} failed")
    sys.exit(tally.failed > 0)


if __name__ == "__main__":
    main()
