"""Listen to a live twin: samples with their pressures, and what happens in between. Needs eclipse-zenoh alone.

python docs/examples/gallery/listen.py demo --samples 3 [--endpoint tcp/127.0.0.1:7447]

It ends after that many samples.
"""

import argparse
import json
import queue

import zenoh


def main():
    """Print samples and events until there are enough samples."""
    parser = argparse.ArgumentParser()
    parser.add_argument("twin")
    parser.add_argument("--samples", type=int, default=10)
    parser.add_argument("--endpoint", default="tcp/127.0.0.1:7447")
    arguments = parser.parse_args()
    config = {
        "mode": "client",
        "connect": {"endpoints": [arguments.endpoint]},
        "scouting": {"multicast": {"enabled": False}},
    }
    messages = queue.SimpleQueue()
    with zenoh.open(zenoh.Config.from_json5(json.dumps(config))) as session:
        session.declare_subscriber(f"hrs/v1/{arguments.twin}/sample", messages.put)
        session.declare_subscriber(f"hrs/v1/{arguments.twin}/event", messages.put)
        left = arguments.samples
        while left:
            message = json.loads(messages.get().payload.to_bytes())
            if "kind" in message:
                print("event", message["kind"], message["details"], flush=True)
                continue
            values = message["values"]
            pressures = ", ".join(f"{name} {values[f'pressure_{name}']:.1f}" for name in ("high", "medium", "low"))
            print(f"sample {message['seq']} at {values['time']:.0f} s: {pressures} bar", flush=True)
            left -= 1


if __name__ == "__main__":
    main()
