"""A tracker as a program: run --tracker 'exec:python docs/examples/exec_tracker.py'.

Nearest neighbour within 3 m, fixed gains. It reads scans from stdin and writes tracks to stdout.
"""

import math
import sys

gain = 0.5
for line in sys.stdin:
    word, *values = line.split()
    if word == "option" and values[0] == "gain":
        gain = float(values[1])
    if word == "end":
        break
print("ready", flush=True)

tracks, next_id, last_s = [], 1, None
while line := sys.stdin.readline():
    _, number, time_s, count = line.split()
    time_s, ego = float(time_s), [float(word) for word in sys.stdin.readline().split()[1:]]
    found = [[float(word) for word in sys.stdin.readline().split()] for _ in range(int(count))]
    sys.stdin.readline(), sys.stdin.readline()  # the free space and the signals are not used here
    step_s, last_s = 0.1 if last_s is None else time_s - last_s, time_s

    for track in tracks:
        track["lon"] += track["lon_speed"] * step_s
        track["lat"] += track["lat_speed"] * step_s
        away = [math.hypot(row[0] - track["lon"], row[1] - track["lat"]) for row in found]
        nearest = away.index(min(away)) if away else None
        if nearest is not None and away[nearest] < 3.0:
            lon, lat, *_ = found.pop(nearest)
            off_lon, off_lat = lon - track["lon"], lat - track["lat"]
            track["lon"] += gain * off_lon
            track["lat"] += gain * off_lat
            track["lon_speed"] += 0.3 * gain * off_lon / step_s
            track["lat_speed"] += 0.3 * gain * off_lat / step_s
            track["hits"] += 1
            track["seen_s"] = time_s
    tracks = [track for track in tracks if time_s - track["seen_s"] < 1.5]
    for lon, lat, *_ in found:
        speed = ego[3] * math.cos(ego[2]), ego[3] * math.sin(ego[2])
        new = {"id": next_id, "lon": lon, "lat": lat, "lon_speed": speed[0], "lat_speed": speed[1]}
        tracks.append(new | {"hits": 1, "seen_s": time_s})
        next_id += 1

    print("tracks", number, len(tracks))
    for track in tracks:
        state = "confirmed" if track["hits"] >= 3 else "tentative"
        speed = math.hypot(track["lon_speed"], track["lat_speed"])
        print(track["id"], track["lon"], track["lat"], speed, 0.0, 0.0, 0.3, 0.2, 1.0, 1.0, state)
    sys.stdout.flush()
