# SPDX-License-Identifier: Apache-2.0
"""
D-WIS manifest of the signals that this program sends, made from the signal table.

A blackboard receives a manifest in JSON and creates the variables that the manifest names (variable provision). A
consumer finds a variable by sentences (subject, verb, object) in the manifest, not by a node id. The fields are those
of ManifestFile in DWIS-Blackboard-Base (D-WIS on GitHub); nouns and verbs come from the DDHub vocabulary
(DrillingDataSemantics, MeasurableQuantityTypes, Uncertainty, PhysicalLocation, DataProviders).
"""

from __future__ import annotations

from typing import Any

from mwd_surface.rig.opcua.address_space import MANIFEST
from mwd_surface.signals.signal import Signal
from mwd_surface.signals.table import TO_RIG
from mwd_surface.signals.units import UNITS

PREFIX = "http://ddhub.no/"
NODES, VARIABLES = "Nodes", "ProvidedVariables"  # aliases used within the manifest
_PROVIDER = "MWDSurface"
_UNCERTAINTY = "GaussianUncertainty"
_SIGMA = "sigma_"
_DEPTH = "DepthDrillingQuantity"
# Nouns of the signal table that are not classes of a signal but nodes to which a signal refers, each with the verb of
# the reference.
_REFERRED = {"NorthEastTVDFrame": "HasReferenceFrame", "BitReferenceLocation": "IsPhysicallyLocatedAt"}


def manifest() -> dict[str, Any]:
    """
    Return the manifest of the signals as a dict that can be written as JSON.

    Each signal becomes a variable with its OPC UA name and a data point that describes it. The blackboard derives the
    namespace of the variables from the name of the application, `MANIFEST`.
    """
    names = {signal.name for signal in TO_RIG}
    nodes: dict[str, str] = {_PROVIDER: "DataProvider"}
    sentences: list[dict[str, Any]] = []

    def say(subject: str, verb: str, target: str, kind: str | None = None) -> None:
        """Add a sentence whose object is a node of the manifest; kind: class of the node, if the node is new."""
        if kind is not None:
            nodes.setdefault(target, kind)
        sentences.append(_sentence(subject, verb, NODES, target))

    for signal in TO_RIG:
        point = f"{signal.opcua}_DataPoint"
        nodes[point] = "DrillingDataPoint"
        sentences.append(_sentence(point, "HasDynamicValue", VARIABLES, signal.opcua))
        say(point, "IsProvidedBy", _PROVIDER)
        quantity = quantity_of(signal)
        say(point, "IsOfMeasurableQuantity", quantity.removesuffix("Quantity"), quantity)
        for noun in signal.dwis:
            if noun in _REFERRED:
                say(point, _REFERRED[noun], noun.removesuffix("Location"), noun)
            elif noun != _UNCERTAINTY:
                sentences.append(_sentence(point, "BelongsToClass", PREFIX, PREFIX + noun))
        measured = signal.name.replace(_SIGMA, "", 1)
        if _UNCERTAINTY in signal.dwis and measured in names:
            of = next(s for s in TO_RIG if s.name == measured)
            uncertainty = f"{of.opcua}_Uncertainty"
            say(f"{of.opcua}_DataPoint", "HasUncertainty", uncertainty, _UNCERTAINTY)
            say(uncertainty, "HasUncertaintyMean", f"{of.opcua}_DataPoint")
            say(uncertainty, "HasUncertaintyStandardDeviation", point)
    return {
        "ManifestName": MANIFEST,
        "Provider": {"Name": MANIFEST, "Company": ""},
        "InjectionInformation": {
            "InjectedVariablesNamespaceAlias": "Variables",
            "InjectedNodesNamespaceAlias": NODES,
            "ProvidedVariablesNamespaceAlias": VARIABLES,
            "InjectedVocabularyNamespaceAlias": "Vocabulary",
        },
        "InjectedNodes": [_node(name, kind) for name, kind in nodes.items()],
        "InjectedVariables": [],
        "ProvidedVariables": [{"VariableID": signal.opcua, "DataType": "double", "Rank": 0} for signal in TO_RIG],
        "InjectedReferences": sentences,
    }


def quantity_of(signal: Signal) -> str:
    """Return the measurable quantity of a signal as a noun of the DDHub vocabulary."""
    if signal.unit == "m" and "depth" in signal.meaning and "difference" not in signal.meaning:
        return _DEPTH
    # A blackboard holds SI values, so temperatures have the quantity of the SI unit, in kelvin.
    return UNITS[signal.unit].quantity


def query(noun: str) -> str:
    """Return the SPARQL query for the variable that holds the present value of a class, such as BitDepth."""
    return (
        "PREFIX rdf: <http://www.w3.org/1999/02/22-rdf-syntax-ns#>\n"
        f"PREFIX ddhub: <{PREFIX}>\n"
        "SELECT ?signal WHERE {\n"
        f"  ?point rdf:type ddhub:{noun} .\n"
        "  ?point ddhub:HasDynamicValue ?signal .\n"
        "}"
    )


def _node(name: str, kind: str) -> dict[str, Any]:
    fields = [{"FieldName": "ProviderName", "FieldValue": _PROVIDER}] if name == _PROVIDER else None
    return {
        "UniqueName": name,
        "BrowseName": name,
        "DisplayName": name,
        "TypeDictionaryURI": PREFIX + kind,
        "Fields": fields,
    }


def _sentence(subject: str, verb: str, namespace: str, target: str) -> dict[str, Any]:
    return {
        "Subject": {"NameSpace": NODES, "ID": subject},
        "VerbURI": PREFIX + verb,
        "Object": {"NameSpace": namespace, "ID": target},
    }
