# SPDX-License-Identifier: Apache-2.0
"""History of the survey variables, from the accepted surveys, readable by HistoryRead (OPC 10000-11)."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping
from typing import Any

from mwd_surface.rig.opcua.address_space import STATUS_CODES, VariableValue
from mwd_surface.rig.opcua.data_value import data_value
from mwd_surface.rig.survey import AcceptedSurvey
from mwd_surface.rig.values import survey_values
from mwd_surface.signals.table import OF_SURVEY

SURVEY_VARIABLES = {signal.opcua: signal.name for signal in OF_SURVEY}


class SurveyHistory:
    """
    History of the server's survey variables, kept equal to the accepted surveys.

    Parameters
    ----------
    ua : module
        `asyncua.ua`.
    server : asyncua.Server
    Node id of each variable by its name.
        From the name of a variable to its node id.
    """

    def __init__(self, ua: Any, server: Any, nodes: Mapping[str, Any]) -> None:
        self._ua, self._server, self._nodes = ua, server, nodes
        self._shown: tuple[AcceptedSurvey, ...] = ()

    async def open(self) -> None:
        """Mark the survey variables as having a history."""
        ua = self._ua
        for name in SURVEY_VARIABLES:
            node = self._server.get_node(self._nodes[name])
            await node.write_attribute(ua.AttributeIds.Historizing, ua.DataValue(True))
            for attribute in (ua.AttributeIds.AccessLevel, ua.AttributeIds.UserAccessLevel):
                await node.set_attr_bit(attribute, ua.AccessLevel.HistoryRead)
        await self._fill(())

    async def show(self, surveys: tuple[AcceptedSurvey, ...]) -> None:
        """Set the accepted surveys, oldest first; a survey that is no longer accepted leaves the history."""
        if surveys != self._shown:
            await self._fill(surveys)

    async def _fill(self, surveys: tuple[AcceptedSurvey, ...]) -> None:
        from asyncua.server.history import HistoryDict

        storage = HistoryDict()
        for name in SURVEY_VARIABLES:
            await storage.new_historized_node(self._nodes[name], None)
        for survey in surveys:
            values = survey_values(survey, survey.decided_ns)
            for name, quantity in SURVEY_VARIABLES.items():
                value = values[quantity]
                reading = VariableValue(value.value, STATUS_CODES[value.condition], survey.stamp_ns)
                await storage.save_node_value(self._nodes[name], data_value(self._ua, reading, "Double"))
            # Saving to memory never yields, so give other clients a turn between two surveys.
            await asyncio.sleep(0)
        self._server.iserver.history_manager.set_storage(storage)
        self._shown = surveys
