"""Compare two controllers on S1 and a scenario of one's own, then read a run's series.

pip install httpx
python with_httpx.py [http://127.0.0.1:8000]
"""

import sys
import time

import httpx

URL = sys.argv[1] if len(sys.argv) > 1 else "http://127.0.0.1:8000"
# A service that other machines reach asks for a key: headers={"Authorization": "Bearer hrs_..."}


def submit(http, path, request):
    """Submit a job and wait for its end."""
    answer = http.post(path, json=request)
    if answer.status_code == httpx.codes.UNPROCESSABLE_ENTITY:
        problems = answer.json()["errors"]
        raise SystemExit("\n".join(f"{problem['field']}: {problem['message']}" for problem in problems))
    answer.raise_for_status()
    place = answer.headers["Location"]
    while (job := http.get(place).raise_for_status().json())["finished"] is None:
        time.sleep(0.1)
    if job["state"] != "succeeded":
        raise SystemExit(f"{job['id']} {job['state']}: {job['problem']}")
    return place, job


def main():
    """Submit a comparison and a run, and print what they found."""
    rush = {"name": "rush", "arrivals": {"kind": "poisson", "rate_per_h": 20, "period_s": 3600}}
    with httpx.Client(base_url=URL, timeout=30) as http:
        request = {"scenarios": ["S1", rush], "controllers": ["logic", "minlp1"], "replications": 5, "seed": 1}
        place, _ = submit(http, "/v1/comparisons", request)
        for row in http.get(f"{place}/results").raise_for_status().json()["results"]:
            print(f"{row['scenario']} {row['controller']:<7} {row['replication']}: waits {row['t_total']:.0f} s in all")

        place, run = submit(http, "/v1/runs", {"scenario": "S1", "controller": "minlp1"})
        print(f"compressor {run['metrics']['t_comp']:.0f} s")
        query = {"columns": "pressure_high,pressure_vehicle", "step_s": 300}
        columns = http.get(f"{place}/series", params=query).raise_for_status().json()["columns"]
        for time_s, pressure in zip(columns["time"], columns["pressure_high"], strict=True):
            print(f"{time_s:>6.0f} s {pressure:7.1f} bar")


if __name__ == "__main__":
    main()
