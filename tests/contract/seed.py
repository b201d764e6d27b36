"""Puts one of everything into a service, so that the fuzzer also meets resources that exist."""


def seed(service, ids):
    """Fills `ids` by name. Raises when the service refuses or a job fails; what was made until then stays in `ids`."""
    folder = service.simulate("rope", "--metres", "2.2", "--views", "1", "--defects", "7", "--defect-free-m", "1.0", "--seed", "3")
    names = ("--ropeway", "North", "--rope", "track rope 1")
    done = service.upload(folder, *names)
    ids["folder"] = folder
    ids.update({k: done[f"{k}_id"] for k in ("ropeway", "rope", "acquisition")})
    service.want("PATCH", f"/ropes/{ids['rope']}/ticketing", {"ticket_level": 1e9})
    half = {"rope_id": ids["rope"], "line_pitch_mm": 0.1, "sensor_px": 480, "views": [{"angle_deg": 0, "frames": 3}]}
    ids["open_acquisition"] = service.want("POST", "/acquisitions", half)["id"]
    frame = (folder / "view0" / "frame_000000.png").read_bytes()
    service.want("PUT", f"/acquisitions/{ids['open_acquisition']}/views/0/frames/0", raw=frame,
                 headers={"Content-Type": "image/png"})
    ids["endpoint"] = service.want("POST", "/webhook-endpoints", {"url": "http://127.0.0.1:9/", "allow_private": True})["id"]
    live = dict(half, views=[{"angle_deg": 0}])
    live = {"kind": "inspect", "acquisition_id": service.want("POST", "/acquisitions", live)["id"], "live": True}
    ids["live_job"] = service.want("POST", "/jobs", live)["id"]
    train = service.job({"kind": "train", "acquisition_id": ids["acquisition"], "to_m": 1.0})
    ids["job"] = train["id"]
    if train["state"] != "succeeded":
        raise RuntimeError(f"training ended as {train}")
    ids["model"] = train["result"]["model_id"]
    # A metre of rope makes a cautious threshold: defects are wanted here, however many are false.
    inspect = service.job({"kind": "inspect", "acquisition_id": ids["acquisition"], "model_id": ids["model"], "threshold": 6.0})
    if inspect["state"] != "succeeded":
        raise RuntimeError(f"inspecting ended as {inspect}")
    ids["inspection"] = inspect["result"]["inspection_id"]
    defects = service.want("GET", f"/inspections/{ids['inspection']}/defects")["items"]
    if len(defects) > 1:
        ids["defect"] = defects[0]["defect_id"]
        service.want("POST", f"/defects/{ids['defect']}/verdict", {"verdict": "confirmed", "by": "seed"})
        ids["delivery"] = service.want("GET", "/deliveries")["items"][0]["id"]
    if defects:
        ids["spare_defect"] = defects[-1]["defect_id"]


def pins(ids):
    """The path of a resource that exists, by the beginning of its route."""
    table = {
        "/api/v1/ropeways/{id}": "ropeway",
        "/api/v1/ropes/{id}": "rope",
        "/api/v1/acquisitions/{id}": "open_acquisition",
        "/api/v1/jobs/{id}/provisional-lay-lengths": "live_job",
        "/api/v1/jobs/{id}/provisional-defects": "live_job",
        "/api/v1/jobs/{id}": "job",
        "/api/v1/models/{id}": "model",
        "/api/v1/inspections/{id}": "inspection",
        "/api/v1/defects/{id}": "defect",
        "/api/v1/webhook-endpoints/{id}": "endpoint",
        "/api/v1/deliveries/{id}": "delivery",
    }
    return {prefix: ids[name] for prefix, name in table.items() if name in ids}
