# SPDX-License-Identifier: Apache-2.0
"""
Access rules of the OPC UA server: settings, security policies, certificates and users, and limits of subscriptions.

On loopback everyone may read if the setting `anonymous` is true. From other machines, and for commands from anywhere, a
session must be signed and encrypted with a certificate that lies in the folder of trusted certificates.
"""

from __future__ import annotations

import contextlib
import contextvars
import dataclasses
import datetime as dt
import hashlib
import itertools
import math
import socket
from pathlib import Path
from typing import Any

from mwd_sensors.core import budgets
from mwd_sensors.core.input_files import read_file
from mwd_sensors.core.settings import setting
from mwd_surface.loopback import is_loopback
from mwd_surface.rig.interface import optional


@dataclasses.dataclass(frozen=True)
class OpcuaSettings:
    """Address of the server, and access rights."""

    enabled: bool = setting(False, "Serve OPC UA.")
    host: str = setting("127.0.0.1", "Address of the network interface on which the server listens.")
    port: int = setting(4840, "TCP port of the server. 0 selects a free port.", low=0, high=65535)
    allow_network: bool = setting(
        False, "Allow a host that other machines can reach. Clients of other machines then need a certificate."
    )
    anonymous: bool = setting(
        True, "Let anonymous clients on this machine read. Clients of other machines always need a certificate."
    )
    allow_commands: bool = setting(False, "Offer methods to clients with a trusted certificate.")
    allow_control: bool = setting(
        False, "Offer the control methods to clients with a trusted certificate. control.enabled must also be set."
    )
    certificates: str = setting(
        "",
        "Folder with the server's certificate own.der and key own.pem, and the folder trusted of client certificates. "
        "Empty: a folder next to the surveys.",
    )
    max_clients: int = setting(
        16, "Largest number of connections at a time. Further connections are refused.", low=1, high=500
    )


APPLICATION = "urn:mwd:surface"


class OpcuaAccess:
    """Access rules of one server."""

    def __init__(self, settings: OpcuaSettings, folder: Path | None, ua: Any) -> None:
        self.settings, self._folder, self._ua = settings, folder, ua
        self._sessions = itertools.count(1)
        self._asking: contextvars.ContextVar[str] = contextvars.ContextVar("asking", default="")

    @property
    def anyone(self) -> bool:
        """Whether anyone may read without a certificate."""
        return self.settings.anonymous and is_loopback(self.settings.host)

    @property
    def needs_certificates(self) -> bool:
        """Whether signed and encrypted sessions are offered."""
        return self.settings.allow_commands or self.settings.allow_control or not self.anyone

    async def secure(self, server: Any) -> None:
        """Set the security policies and the certificate of the server."""
        policies = []
        if self.anyone:
            policies.append(self._ua.SecurityPolicyType.NoSecurity)
        if self.needs_certificates:
            policies.append(self._ua.SecurityPolicyType.Basic256Sha256_SignAndEncrypt)
            if self._folder is not None:
                await self._certify(server, self._folder)
        # Allow no request until the channels get their own rules, just after the port opens.
        server.set_security_policy(policies, permission_ruleset=self._rules(set()))
        server.set_identity_tokens([self._ua.AnonymousIdentityToken])

    def channels(self, server: Any) -> list[Any]:
        """
        Return the kinds of channels with the requests that each allows.

        Access depends on the channel, not on the user alone, because without encryption a client can present the
        certificate of another client.
        """
        policies = optional("asyncua.crypto.security_policies", "asyncua", "OPC UA")
        rules = optional("asyncua.crypto.permission_rules", "asyncua", "OPC UA")
        ids, modes = self._ua.ObjectIds, self._ua.MessageSecurityMode
        call, write = ids.CallRequest_Encoding_DefaultBinary, ids.WriteRequest_Encoding_DefaultBinary
        reading = {*rules.USER_TYPES, ids.BrowseNextRequest_Encoding_DefaultBinary} - {call, write}
        in_clear = reading if self.anyone else set()
        trusted = reading | {call}
        kinds = [
            policies.SecurityPolicyFactory(policies.SecurityPolicyNone, modes.None_, None, None, self._rules(in_clear))
        ]
        if self.needs_certificates:
            secure = policies.SecurityPolicyBasic256Sha256
            own = server.iserver.certificate, server.iserver.private_key
            kinds.append(policies.SecurityPolicyFactory(secure, modes.SignAndEncrypt, *own, self._rules(trusted)))
        return kinds

    def _rules(self, types: set[int]) -> Services:
        return Services(self._ua, {self._ua.NodeId(number) for number in types}, self._asking)

    @property
    def identity(self) -> str:
        """
        Session and certificate of the present request; valid in the task of the request.

        A copy of the context of the task has the same value.
        """
        return self._asking.get()

    async def _certify(self, server: Any, folder: Path) -> None:
        trusted = folder / "trusted"
        trusted.mkdir(parents=True, exist_ok=True, mode=0o700)
        generator = optional("asyncua.crypto.cert_gen", "asyncua", "OPC UA")
        oids = optional("cryptography.x509.oid", "cryptography", "OPC UA").ExtendedKeyUsageOID
        key, certificate = folder / "own.pem", folder / "own.der"
        await generator.setup_self_signed_certificate(
            key,
            certificate,
            APPLICATION,
            socket.gethostname(),
            [oids.CLIENT_AUTH, oids.SERVER_AUTH],
            {"commonName": "MWD surface", "organizationName": "MWD telemetry"},
        )
        key.chmod(0o600)
        await server.load_certificate(certificate)
        await server.load_private_key(key)

    def get_user(
        self, _server: Any, username: str | None = None, password: str | None = None, certificate: bytes | None = None
    ) -> Any:
        """
        Return the user of a session from the certificate of its channel; None refuses the session.

        asyncua calls this method of its user manager. A session with a name or a password is refused.

        asyncua calls this function once for each activation of a session, so the name of the user identifies session
        and certificate.
        """
        if username or password:
            return None
        rules = optional("asyncua.crypto.permission_rules", "asyncua", "OPC UA")
        if not certificate:
            return rules.User(role=rules.UserRole.Anonymous) if self.anyone else None
        if self._folder is None or not self.needs_certificates:
            return None
        x509 = optional("cryptography.x509", "cryptography", "OPC UA")
        shown, now = x509.load_der_x509_certificate(certificate), dt.datetime.now(dt.UTC)
        # Read the folder for each session, so that removing a certificate revokes it.
        known = shown in _certificates(self._folder / "trusted", x509)
        valid = shown.not_valid_before_utc <= now <= shown.not_valid_after_utc
        identity = f"session {next(self._sessions)} of {hashlib.sha256(certificate).hexdigest()}"
        return rules.User(role=rules.UserRole.User, name=identity) if known and valid else None


class Services:
    """
    Permission rules for asyncua: the services that a channel may request, whoever the user is.

    ConditionRefresh may be called even where other methods may not: it changes nothing, and shows the alarms to a
    client that connects late. asking: context variable that receives the identity of the user, for methods called in
    the task of the request.
    """

    def __init__(self, ua: Any, allowed: set[Any], asking: contextvars.ContextVar[str]) -> None:
        self._ua, self._allowed, self._asking = ua, allowed, asking

    def check_validity(self, user: Any, action_type_id: Any, body: Any) -> bool:
        """Return whether the service may be requested; set `asking` to the name of the user."""
        self._asking.set(getattr(user, "name", None) or "")
        if action_type_id in self._allowed:
            return True
        ids = self._ua.ObjectIds
        call = self._ua.NodeId(ids.CallRequest_Encoding_DefaultBinary)
        read = self._ua.NodeId(ids.ReadRequest_Encoding_DefaultBinary)
        if action_type_id != call or read not in self._allowed:
            return False
        binary = optional("asyncua.ua.ua_binary", "asyncua", "OPC UA")
        asked = binary.struct_from_binary(self._ua.CallParameters, body.copy())
        refresh = self._ua.NodeId(ids.ConditionType_ConditionRefresh)
        return all(method.MethodId == refresh for method in asked.MethodsToCall)


def _certificates(folder: Path, x509: Any) -> list[Any]:
    """Return the certificates in a folder, DER or PEM; other files are ignored."""
    found = []
    for path in sorted(folder.iterdir()):
        with contextlib.suppress(ValueError, OSError):
            data = read_file(path, budgets.CERTIFICATE)
            load = x509.load_pem_x509_certificate if data.startswith(b"-----") else x509.load_der_x509_certificate
            found.append(load(data))
    return found


# Limits of subscriptions that asyncua does not set itself. A client on this machine needs no certificate, and each of
# its monitored items costs memory and, at every new value, time in the process of the surface node. asyncua limits
# the number of subscriptions, but not of their items. It accepts any publishing interval, however short, and lets a
# later request lengthen a queue beyond the limit of the server.

# Largest number of monitored items on the server; a client that watches every variable has about a hundred
MOST_ITEMS = 4000
LONGEST_QUEUE = 100  # largest number of values in the queue of one item; the variables change once per second
SHORTEST_MS, LONGEST_MS = 100.0, 3_600_000.0  # limits of the publishing interval, ms


class SubscriptionLimits:
    """
    Limiter in front of the subscription service of a server.

    Parameters
    ----------
    service : asyncua.server.subscription_service.SubscriptionService
        Service whose methods that answer requests are replaced by the methods of this object.
    """

    def __init__(self, ua: Any, service: Any) -> None:
        self._ua, self._service = ua, service
        self._items: dict[int, set[int]] = {}
        self.refused = 0
        self._create_subscription = service.create_subscription
        self._create, self._modify, self._delete = (
            service.create_monitored_items,
            service.modify_monitored_items,
            service.delete_monitored_items,
        )
        service.create_subscription = self.create_subscription
        service.create_monitored_items = self.create_monitored_items
        service.modify_monitored_items = self.modify_monitored_items
        service.delete_monitored_items = self.delete_monitored_items

    @property
    def items(self) -> int:
        """Number of monitored items on the server; may be read from any thread."""
        return sum(len(made) for number, made in list(self._items.items()) if number in self._service.subscriptions)

    async def create_subscription(self, params: Any, *args: Any, **named: Any) -> Any:
        """Create a subscription with its publishing interval limited; an infinite one becomes the longest allowed."""
        asked = params.RequestedPublishingInterval
        params.RequestedPublishingInterval = (
            min(max(asked, SHORTEST_MS), LONGEST_MS) if math.isfinite(asked) else LONGEST_MS
        )
        return await self._create_subscription(params, *args, **named)

    async def create_monitored_items(self, params: Any) -> list[Any]:
        """Create as many of the items as the limit allows; further items get BadTooManyMonitoredItems."""
        for ended in self._items.keys() - self._service.subscriptions.keys():
            del self._items[ended]
        asked = params.ItemsToCreate
        room = max(0, MOST_ITEMS - self.items)
        params.ItemsToCreate = asked[:room]
        results = list(await self._create(params))
        made = self._items.setdefault(params.SubscriptionId, set())
        made |= {result.MonitoredItemId for result in results if result.StatusCode.is_good()}
        for _ in asked[room:]:
            refusal = self._ua.MonitoredItemCreateResult()
            refusal.StatusCode = self._ua.StatusCode(self._ua.StatusCodes.BadTooManyMonitoredItems)
            results.append(refusal)
            self.refused += 1
        return results

    def modify_monitored_items(self, params: Any) -> Any:
        """Change monitored items, with queues limited to LONGEST_QUEUE."""
        for item in params.ItemsToModify:
            wanted = item.RequestedParameters
            wanted.QueueSize = min(wanted.QueueSize or LONGEST_QUEUE, LONGEST_QUEUE)
        return self._modify(params)

    def delete_monitored_items(self, params: Any) -> Any:
        """Delete monitored items, and remove them from the count."""
        results = self._delete(params)
        self._items.get(params.SubscriptionId, set()).difference_update(params.MonitoredItemIds)
        return results
