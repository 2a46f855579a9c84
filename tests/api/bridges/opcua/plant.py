"""A plant at an OPC UA server in a process of its own; nothing of it is the product's.

`python plant.py SERIES.json`: the file has `url`, `begin` (Unix time of the first tick), `every_s` between ticks,
`stamp` and `step_s` (SourceTimestamp of the first tick, and between two), `values` (a list for each node, null for NaN)
and `history`. The plant goes on while the server is away, and its historian keeps that: a server that is started again
knows the past.
"""

import asyncio
import json
import logging
import math
import sys
import time
from datetime import UTC, datetime, timedelta
from pathlib import Path

from asyncua import Server, ua


class Plant:
    """The nodes of a plant, and what its historian keeps."""

    def __init__(self, series, server, index) -> None:
        self._series, self._server, self._index = series, server, index
        self._storage = server.iserver.history_manager.storage
        self._nodes = {}
        self._first = datetime.fromtimestamp(series["stamp"], UTC)

    async def make(self):
        for name in self._series["values"]:
            place = ua.NodeId(name, self._index)
            node = await self._server.nodes.objects.add_variable(place, name, math.nan, ua.VariantType.Double)
            self._nodes[name] = node
            if self._series["history"]:
                await self._storage.new_historized_node(node.nodeid, None)

    def due(self):
        """How many ticks there have been."""
        ticks = len(next(iter(self._series["values"].values())))
        passed = math.floor((time.time() - self._series["begin"]) / self._series["every_s"]) + 1
        return max(0, min(ticks, passed))

    async def tell(self, tick, *, live):
        """Keep the values of a tick, and where it is `live` show them."""
        moment = self._first + tick * timedelta(seconds=self._series["step_s"])
        for name, node in self._nodes.items():
            figure = self._series["values"][name][tick]
            content = ua.Variant(math.nan if figure is None else figure, ua.VariantType.Double)
            told = ua.DataValue(content, SourceTimestamp=moment)
            if self._series["history"]:
                await self._storage.save_node_value(node.nodeid, told)
            if live:
                await node.write_value(told)


async def main(series):
    logging.disable(logging.CRITICAL)
    server = Server()
    await server.init()
    server.set_endpoint(series["url"])
    server.set_security_policy([ua.SecurityPolicyType.NoSecurity])
    plant = Plant(series, server, await server.register_namespace("urn:plant"))
    await plant.make()
    told = plant.due()
    for tick in range(told):
        await plant.tell(tick, live=tick == told - 1)
    async with server:
        print("ready", flush=True)
        while True:
            while told < plant.due():
                await plant.tell(told, live=True)
                told += 1
            await asyncio.sleep(series["every_s"] / 4)


if __name__ == "__main__":
    asyncio.run(main(json.loads(Path(sys.argv[1]).read_text())))  # noqa: TID251  # a program of its own
