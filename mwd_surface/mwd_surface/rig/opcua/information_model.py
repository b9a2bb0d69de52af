# SPDX-License-Identifier: Apache-2.0
"""Static part of the address space: the well, its type, its variables with units, and the namespace metadata."""

from __future__ import annotations

from typing import Any

from mwd_surface import __version__
from mwd_surface.rig.opcua.address_space import (
    MANIFEST,
    NAMESPACE,
    UNITS_NAMESPACE,
    VARIABLES,
    Variable,
    unit_id,
    variable_values,
)
from mwd_surface.rig.opcua.data_value import EPOCH
from mwd_surface.rig.values import nothing_yet
from mwd_surface.signals.units import UNITS

SAMPLING_MS = 100.0  # shortest interval at which values are written


async def add_well(ua: Any, server: Any, well: str) -> tuple[Any, dict[str, Any]]:
    """
    Add the object of the well with its variables.

    Parameters
    ----------
    ua : module
        `asyncua.ua`.
    server : asyncua.Server
    well : str
        Browse name of the object.

    Returns
    -------
    asyncua.Node
        The object.
    dict
        Node id of each variable by its name.
    """
    index = await server.register_namespace(NAMESPACE)
    await _describe_namespace(ua, server, index)
    kind = await server.nodes.base_object_type.add_object_type(
        ua.NodeId(f"{MANIFEST}Type", index), f"{index}:{MANIFEST}Type"
    )
    # The type declares the variables; the well has its own instances with values.
    await _declare(ua, kind, index)
    node = await server.nodes.objects.add_object(ua.NodeId(MANIFEST, index), f"{index}:{well}")
    objects, organizes = server.nodes.objects, ua.ObjectIds.Organizes
    await _set_type(ua, objects, organizes, node, ua.ObjectIds.BaseObjectType, kind)
    return node, {v.name: (await _variable(ua, node, index, v, f"{MANIFEST}.{v.name}")).nodeid for v in VARIABLES}


async def _declare(ua: Any, kind: Any, index: int) -> None:
    for variable in VARIABLES:
        declared = await _variable(ua, kind, index, variable, f"{MANIFEST}Type.{variable.name}")
        await declared.set_modelling_rule(True)


async def _variable(ua: Any, parent: Any, index: int, variable: Variable, identifier: str) -> Any:
    first = variable_values(nothing_yet())[variable.name].value
    variant = ua.Variant(first, getattr(ua.VariantType, variable.kind))
    node = await parent.add_variable(ua.NodeId(identifier, index), f"{index}:{variable.name}", variant)
    described = ua.DataValue(ua.Variant(ua.LocalizedText(variable.description), ua.VariantType.LocalizedText))
    await node.write_attribute(ua.AttributeIds.Description, described)
    sampling = ua.DataValue(ua.Variant(SAMPLING_MS, ua.VariantType.Double))
    await node.write_attribute(ua.AttributeIds.MinimumSamplingInterval, sampling)
    if variable.unit:
        plain, analog = ua.ObjectIds.BaseDataVariableType, ua.ObjectIds.AnalogUnitType
        await _set_type(ua, parent, ua.ObjectIds.HasComponent, node, plain, analog)
        unit = ua.EUInformation(
            NamespaceUri=UNITS_NAMESPACE,
            UnitId=unit_id(variable.unit),
            DisplayName=ua.LocalizedText(variable.unit),
            Description=ua.LocalizedText(UNITS[variable.unit].name),
        )
        await node.add_property(0, "EngineeringUnits", unit)
    return node


async def _set_type(ua: Any, parent: Any, reference: Any, node: Any, old: Any, new: Any) -> None:
    """Change the type of a node, and recreate the parent's reference, from which a browsing client reads the type."""
    await node.delete_reference(old, ua.ObjectIds.HasTypeDefinition)
    await node.add_reference(new, ua.ObjectIds.HasTypeDefinition, True, False)
    await parent.delete_reference(node, reference)
    await parent.add_reference(node, reference, True, True)


async def _describe_namespace(ua: Any, server: Any, index: int) -> None:
    """Add NamespaceMetadata (OPC 10000-5, 6.3.13): the version, and that node ids are strings that do not change."""
    namespaces = server.get_node(ua.ObjectIds.Server_Namespaces)
    node = await namespaces.add_object(
        ua.NodeId(f"{MANIFEST}.Metadata", index), f"{index}:{NAMESPACE}", objecttype=ua.ObjectIds.NamespaceMetadataType
    )
    values = {
        "NamespaceUri": ua.Variant(NAMESPACE, ua.VariantType.String),
        "NamespaceVersion": ua.Variant(__version__, ua.VariantType.String),
        "NamespacePublicationDate": ua.Variant(EPOCH, ua.VariantType.DateTime),
        "IsNamespaceSubset": ua.Variant(False, ua.VariantType.Boolean),
        "StaticNodeIdTypes": ua.Variant([int(ua.IdType.String)], ua.VariantType.Int32),
    }
    for name, value in values.items():
        await (await node.get_child(f"0:{name}")).write_value(value)
