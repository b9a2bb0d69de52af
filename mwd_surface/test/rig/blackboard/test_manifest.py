# SPDX-License-Identifier: Apache-2.0
"""The manifest says of every signal what it is, in words of the vocabulary, and refers to nothing that is not there."""

import json
import re

import pytest

from mwd_surface.rig.blackboard.client import NODES, PREFIX, VARIABLES, manifest, quantity_of, query
from mwd_surface.signals.table import BY_NAME, TO_RIG
from mwd_surface.signals.units import UNITS

# Nouns and verbs of the DDHub vocabulary that are used here.
NOUNS = {
    *("DrillingDataPoint", "DataProvider", "GaussianUncertainty", "NorthEastTVDFrame", "BitReferenceLocation"),
    *("Inclination", "Azimuth", "MeasuredDepth", "BitDepth", "HoleDepth", "DownholeRPM", "SurfaceRPM"),
    *("DownholeTemperature", "SurfaceTorque", "FlowRateIn", "Measurement", "DerivedMeasurement"),
    *("CorrectedMeasurement", "ComputedData", "RecommendedTarget", "SetPoint", "Limit"),
    *(unit.quantity for unit in UNITS.values()),
    "DepthDrillingQuantity",
}
VERBS = {
    *("HasDynamicValue", "IsProvidedBy", "IsOfMeasurableQuantity", "BelongsToClass", "HasUncertainty"),
    *("HasUncertaintyMean", "HasUncertaintyStandardDeviation", "HasReferenceFrame", "IsPhysicallyLocatedAt"),
}
TABLE = json.loads(json.dumps(manifest()))


def sentences(subject):
    return {
        (row["VerbURI"].removeprefix(PREFIX), row["Object"]["ID"].removeprefix(PREFIX))
        for row in TABLE["InjectedReferences"]
        if row["Subject"]["ID"] == subject
    }


def test_every_sentence_is_of_the_vocabulary_and_about_what_the_manifest_has():
    nodes = {node["UniqueName"] for node in TABLE["InjectedNodes"]}
    variables = {variable["VariableID"] for variable in TABLE["ProvidedVariables"]}
    assert len(nodes) == len(TABLE["InjectedNodes"])
    for row in TABLE["InjectedReferences"]:
        assert row["Subject"] == {"NameSpace": NODES, "ID": row["Subject"]["ID"]}
        assert row["Subject"]["ID"] in nodes
        assert row["VerbURI"].removeprefix(PREFIX) in VERBS
        place, name = row["Object"]["NameSpace"], row["Object"]["ID"]
        assert name in {NODES: nodes, VARIABLES: variables, PREFIX: {PREFIX + noun for noun in NOUNS}}[place]
    assert {node["TypeDictionaryURI"].removeprefix(PREFIX) for node in TABLE["InjectedNodes"]} <= NOUNS
    assert variables == {signal.opcua for signal in TO_RIG}


@pytest.mark.parametrize("signal", TO_RIG, ids=lambda signal: signal.name)
def test_every_signal_has_a_value_a_provider_and_a_quantity(signal):
    said = sentences(f"{signal.opcua}_DataPoint")
    assert ("HasDynamicValue", signal.opcua) in said
    assert ("IsProvidedBy", "MWDSurface") in said
    assert ("IsOfMeasurableQuantity", quantity_of(signal).removesuffix("Quantity")) in said


def test_a_sigma_is_the_uncertainty_of_what_it_belongs_to():
    assert ("HasUncertainty", "Inclination_Uncertainty") in sentences("Inclination_DataPoint")
    assert sentences("Inclination_Uncertainty") == {
        ("HasUncertaintyMean", "Inclination_DataPoint"),
        ("HasUncertaintyStandardDeviation", "InclinationSigma_DataPoint"),
    }


def test_depths_are_depths_and_differences_are_lengths():
    assert quantity_of(BY_NAME["bit_depth"]) == "DepthDrillingQuantity"
    assert quantity_of(BY_NAME["depth_difference"]) == "LengthStandardQuantity"
    assert quantity_of(BY_NAME["plan_up"]) == "LengthStandardQuantity"


def test_a_query_asks_for_the_variable_of_a_noun():
    assert re.findall(r"ddhub:(\w+)", query("BitDepth"))[-2:] == ["BitDepth", "HasDynamicValue"]
