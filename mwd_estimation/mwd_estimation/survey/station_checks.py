"""What is checked at one station beside its totals: field, interference and what the attitude hides; as reasons."""

from __future__ import annotations

from dataclasses import dataclass

from mwd_estimation.core.reasons import Reason
from mwd_estimation.core.reasons import ReasonCode as Code
from mwd_estimation.core.reference_field import Reference
from mwd_estimation.magnetic.axial_correction import AxialCorrection
from mwd_estimation.survey import azimuth_selection
from mwd_estimation.survey.acceptance import ACCEPT, DOUBTFUL, worse
from mwd_estimation.survey.azimuth_method import AzimuthMethod
from mwd_estimation.survey.station_settings import StationSettings


class Findings:
    """Verdict so far, the reasons that made it, and remarks that did not."""

    def __init__(self) -> None:
        self.verdict = ACCEPT
        self.reasons: list[Reason] = []
        self.remarks: list[Reason] = []

    def add(self, verdict: str, *reasons: Reason) -> None:
        """Add reasons for a verdict; the graver of all verdicts that have a reason stands."""
        if reasons:
            self.verdict = worse(self.verdict, verdict)
            self.reasons += reasons

    def remark(self, reason: Reason) -> None:
        """Add something to know that does not touch the verdict."""
        self.remarks.append(reason)


@dataclass(frozen=True)
class Correction:
    """
    What the single-station correction of a station came to.

    Attributes
    ----------
    estimate : AxialCorrection or None
        None without a reference field or a magnetic reading.
    refused : Reason or None
        Why its azimuth must not be used.
    chosen : bool
        Whether its azimuth is the station's.
    hidden : bool
        Whether interference that this attitude does not show could turn the azimuth far beyond its sigma.
    """

    estimate: AxialCorrection | None = None
    refused: Reason | None = None
    chosen: bool = False
    hidden: bool = False

    @property
    def interference(self) -> tuple[float, float]:
        """Axial interference and 1 sigma, T; nan where it is not known."""
        if self.estimate is None:
            return float("nan"), float("nan")
        return float(self.estimate.interference), float(self.estimate.sigma_interference)


def check_field(
    findings: Findings, settings: StationSettings, reference: Reference | None, north: str, horizontal: float
) -> None:
    """Doubt a station without a reference field or with a weak horizontal field, T."""
    if reference is None or not reference.has_field:
        findings.add(DOUBTFUL, Reason(Code.NO_REFERENCE_FIELD, names=(north,)))
    limit = settings.quality.min_horizontal_field_nt * 1e-9
    if horizontal < limit:
        findings.add(DOUBTFUL, Reason(Code.WEAK_HORIZONTAL_FIELD, horizontal, limit))


def check_interference(findings: Findings, settings: StationSettings, correction: Correction) -> tuple[Reason, ...]:
    """Report the interference that shows; returns the reasons that doubt nothing but the magnetic azimuth."""
    refused, wanted = correction.refused, settings.azimuth_method
    if wanted == AzimuthMethod.SINGLE_STATION and not correction.chosen:
        why = refused or Reason(Code.NO_FIELD_TO_CORRECT_BY)
        findings.add(DOUBTFUL, Reason(Code.NOT_CORRECTED, causes=(why,)))
    if correction.estimate is None:
        return ()
    expected = settings.errors.axial_interference_nt * 1e-9
    if not (correction.chosen or azimuth_selection.shows(correction.estimate, expected)):
        return ()
    shown, sigma = correction.interference
    if correction.chosen and refused:
        doubt = Reason(Code.INTERFERENCE_CORRECTED_UNSURELY, shown, values=(sigma,), causes=(refused,))
        findings.add(DOUBTFUL, doubt)
        return (doubt,)
    if correction.chosen:
        findings.remark(Reason(Code.INTERFERENCE_CORRECTED, shown, values=(sigma,)))
    elif wanted == AzimuthMethod.RAW:
        findings.add(DOUBTFUL, Reason(Code.INTERFERENCE_LEFT_BY_SETTING, shown, values=(sigma,)))
    elif refused and wanted != AzimuthMethod.SINGLE_STATION:
        findings.remark(Reason(Code.INTERFERENCE_NOT_CORRECTED, shown, values=(sigma,), causes=(refused,)))
    return ()


def check_hidden(findings: Findings, slope: float, hidden: bool) -> tuple[Reason, ...]:
    """
    Doubt an azimuth whose interference this attitude hides; slope: of the azimuth by the axial field, rad/T.

    A corrected one too: it is chosen where its uncertain estimate happens to be large.
    """
    if not hidden:
        return ()
    doubt = Reason(Code.INTERFERENCE_HIDDEN, abs(slope) * 1e-6)
    findings.add(DOUBTFUL, doubt)
    return (doubt,)
