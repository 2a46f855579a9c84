"""A server of live twins, until it is interrupted."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable

from asyncua import Server, ua

from api.bridges.opcua.endpoint import APPLICATION, Certificate, Endpoint, OpcUaError, properties_of, wrong
from api.bridges.opcua.history import ServiceHistory, prepare
from api.bridges.opcua.nodes import NAMESPACE
from api.bridges.opcua.served import ServedTwin
from api.bridges.opcua.users import KeyHolders, Readers
from api.client import Service

LOOK_S = 0.2
"""How often it is looked whether to end [s]."""

PRODUCT = "urn:hrs-twin"


class TwinServer:
    """Serves live twins to OPC UA clients, to be read alone.

    Parameters
    ----------
    service
        That the twins live in.
    twins
        Their ids.
    endpoint
        To listen at.
    certificate
        Of the server; None: without security, on loopback alone.
    url
        Of the service, which says whose key is valid.

    Raises
    ------
    InputError
        if another machine reaches the endpoint and there is no certificate.
    StationError
        if there is no such twin, the service does not answer, or asks nobody for a key where one is needed.
    """

    def __init__(
        self, service: Service, twins: list[str], endpoint: Endpoint, certificate: Certificate | None, url: str
    ) -> None:  # fmt: skip
        if certificate is None and not endpoint.is_loopback:
            message = f"must be given where other machines can connect; --endpoint is {endpoint.url}"
            raise wrong("--certificate", message)
        if endpoint.user is not None:
            raise wrong("--endpoint", "must name no user: who connects does")
        self._endpoint, self._certificate = endpoint, certificate
        self._users = Readers() if certificate is None else KeyHolders(url)
        self._twins = [ServedTwin(service.twin(name)) for name in twins]

    def run(self, ending: threading.Event, opened: Callable[[], None] = lambda: None) -> None:
        """Serve until `ending` is set; `opened` is called when clients can connect.

        Raises
        ------
        OpcUaError
            if nobody can listen at the endpoint.
        """
        with asyncio.Runner() as runner:
            runner.run(self._serve(ending, opened))

    async def _serve(self, ending: threading.Event, opened: Callable[[], None]) -> None:
        server = await self._made()
        try:
            await server.start()
        except OSError as error:
            raise OpcUaError(f"nobody can listen at {self._endpoint.url} ({error.strerror or error})") from None
        tasks = [asyncio.create_task(twin.follow()) for twin in self._twins]
        try:
            for twin in self._twins:
                twin.listen(ending)
            opened()
            while not ending.is_set():
                await asyncio.sleep(LOOK_S)
        finally:
            for task in tasks:
                task.cancel()
            await server.stop()

    async def _made(self) -> Server:
        prepare()
        server = Server(user_manager=self._users)
        server.iserver.allow_remote_admin = False
        history = server.iserver.history_manager = ServiceHistory(server.iserver)
        server.iserver.bind_condition_methods = 1  # severity of the events around a refresh
        await server.init()
        # Clients refuse a server that calls itself otherwise than its certificate does.
        await server.set_application_uri(self._certificate.application_uri if self._certificate else APPLICATION)
        server.product_uri, server.name, server.manufacturer_name = PRODUCT, "hrs-twin", "hrs-twin"
        server.application_type = ua.ApplicationType.Server
        server.set_endpoint(self._endpoint.url)
        await self._secure(server)
        namespace = await server.register_namespace(NAMESPACE)
        for twin in self._twins:
            await twin.make(server, namespace)
            history.add(twin, twin.nodes.variables)
        return server

    async def _secure(self, server: Server) -> None:
        """Let in who may come in: on loopback everybody, else who signs, encrypts, and has a key of the service."""
        if self._certificate is None:
            server.set_security_policy([ua.SecurityPolicyType.NoSecurity])
            server.set_identity_tokens([ua.AnonymousIdentityToken])
            return
        shown, key = properties_of(self._certificate.certificate), properties_of(self._certificate.private_key)
        await server.load_certificate(shown.path_or_content, shown.extension)
        await server.load_private_key(key.path_or_content, format=key.extension)
        server.set_security_policy([ua.SecurityPolicyType.Basic256Sha256_SignAndEncrypt])
        server.set_identity_tokens([ua.UserNameIdentityToken])
