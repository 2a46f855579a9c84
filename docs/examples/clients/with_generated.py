"""The same API through a client generated from its OpenAPI document.

pip install openapi-python-client
openapi-python-client generate --url http://127.0.0.1:8000/openapi.json --meta none --output-path hrs_client
python with_generated.py [http://127.0.0.1:8000]
"""

import sys
import time

from hrs_client import Client
from hrs_client.api.runs import get_run, submit_run
from hrs_client.api.twins import add_vehicle, start_twin, stop_twin
from hrs_client.models import Problem, RunRequest, TwinOrder, VehicleRequest

URL = sys.argv[1] if len(sys.argv) > 1 else "http://127.0.0.1:8000"


def right(answer):
    """The answer, unless it is a problem."""
    if isinstance(answer, Problem):
        raise SystemExit(f"{answer.title}: {answer.detail}")
    return answer


def main():
    """Run a scenario, then let a vehicle arrive at a live twin."""
    with Client(base_url=URL) as client:
        run = right(
            submit_run.sync(client=client, body=RunRequest.from_dict({"scenario": "S1", "controller": "minlp1"}))
        )
        while run.finished is None:
            time.sleep(0.1)
            run = right(get_run.sync(run.id, client=client))
        print(f"{run.id} {run.state}: waits {run.metrics['t_total']:.0f} s in all")

        twin = right(start_twin.sync(client=client, body=TwinOrder.from_dict({"scenario": "S1", "speed": 10.0})))
        twin = right(add_vehicle.sync(twin.id, client=client, body=VehicleRequest(start_pressure_bar=120.0)))
        print(f"{twin.id} {twin.state}, {twin.samples} samples")
        twin = right(stop_twin.sync(twin.id, client=client))
        print(f"{twin.id} {twin.state}")


if __name__ == "__main__":
    main()
