"""Our webhooks, received and verified by the reference implementation of Standard Webhooks in another language."""

import http.server
import json
import threading
import time

from standardwebhooks.webhooks import Webhook


class Receiver:
    """Takes posts; the first answer is 500, so that every event comes at least twice."""

    def __init__(self):
        self.received = []
        outer = self

        class Handler(http.server.BaseHTTPRequestHandler):
            def do_POST(self):
                body = self.rfile.read(int(self.headers["content-length"]))
                first = not outer.received
                outer.received.append((dict((k.lower(), v) for k, v in self.headers.items()), body))
                self.send_response(500 if first else 204)
                self.send_header("content-length", "0")
                self.end_headers()

            def log_message(self, *_):
                pass

        self.server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self.url = f"http://127.0.0.1:{self.server.server_address[1]}/tickets"
        threading.Thread(target=self.server.serve_forever, daemon=True).start()

    def wait_for(self, count, timeout_s=60):
        end = time.monotonic() + timeout_s
        while len(self.received) < count and time.monotonic() < end:
            time.sleep(0.1)
        return len(self.received) >= count


def checks(service, defect_id):
    """Yields (name, ok, what was seen)."""
    receiver = Receiver()
    endpoint = service.want("POST", "/webhook-endpoints", {"url": receiver.url, "allow_private": True})
    service.want("POST", f"/defects/{defect_id}/verdict", {"verdict": "confirmed", "by": "contract test"})
    arrived = receiver.wait_for(2)
    yield "a confirmed defect arrives, and again after a failure", arrived, f"{len(receiver.received)} posts"
    if not arrived:
        return
    for number, (headers, body) in enumerate(receiver.received[:2], 1):
        try:
            event = Webhook(endpoint["secret"]).verify(body, headers)
            yield f"attempt {number} verifies with the reference implementation", True, ""
        except Exception as error:
            yield f"attempt {number} verifies with the reference implementation", False, repr(error)
            return
    ids = {headers["webhook-id"] for headers, _ in receiver.received[:2]}
    yield "both attempts have the same webhook-id", len(ids) == 1, str(ids)
    needed = {"specversion", "type", "source", "id", "subject", "time", "datacontenttype", "data"}
    yield "the body is a CloudEvent", needed <= event.keys() and event["specversion"] == "1.0", json.dumps(event)[:300]
    ticket = {"number": "4711", "url": "https://maintenance.example/4711", "state": "open"}
    own = service.token
    service.token = service.new_token("ticketing")
    status, answer = service.call("PUT", event["data"]["links"]["ticket"].split("/api/v1", 1)[1], ticket)
    service.token = own
    yield "the receiver writes its ticket back", status == 200, f"{status} {answer}"
    held = service.want("GET", f"/defects/{defect_id}")
    yield "the defect carries the ticket", (held.get("ticket") or {}).get("number") == "4711", str(held)[:300]
    for _ in range(50):  # the answer arrives at the service a moment after the post arrived here
        states = {d["state"] for d in service.want("GET", "/deliveries")["items"] if d["defect_id"] == defect_id and d.get("endpoint_id", endpoint["id"]) == endpoint["id"]}
        if states == {"delivered"}:
            break
        time.sleep(0.2)
    yield "the delivery is settled", states == {"delivered"}, str(states)
