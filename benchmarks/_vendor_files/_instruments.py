"""Rheometers, dynamic analysers, magnetometers and testers of polarisation."""

from collections.abc import Mapping

import numpy as np

from ._machines import NONE, NUMBERS, ONES, TEMPERATURE
from ._variant import ANSWER, DRIVE, SWING, SWITCHED, TIME, N, Variant, table

T, RATE, STRESS = TIME.tolist(), DRIVE.tolist(), ANSWER.tolist()
FIELD, MOMENT = (1e3 * SWING).tolist(), SWITCHED.tolist()
STAMPS = (3.7e9 + TIME).tolist()
ERRORS = (1e-3 * (1.5 + np.sin(7 * TIME))).tolist()
MODULI = (5 + np.sin(TIME)).tolist(), (2 + np.cos(TIME)).tolist()

Q800 = (
    "Version\tUniversal V4.5A\nLanguage\tEnglish\nRun\t12\nProgram\tMainExe\nInstrument\tDMA Q800 V21.1\n"
    "Module\tDMA Film\nOperator\tA\nNsig\t5\nSig1\tTime (min)\nSig2\tTemperature (°C)\n"
    "Sig3\tStatic Force (N)\nSig4\tStress (MPa)\nSig5\tStrain (%)\nDate\t05-Nov-20\nTime\t10:00:00\n"
    "OrgFile\tC:\\a.001\nStartOfData\n"
)
TRIOS = "Filename\ta.tri\nInstrument name\tHR30\n[File Parameters]\nSample thickness\t1.0 mm\n"
RHEOPLUS = (
    "Data Series Information\n\nName:\tFlow 1\nNumber of Intervals:\t1\nApplication:\tRHEOPLUS/32 V3.40\n\n"
    "Interval:\t1\nNumber of Data Points:\t160\nTime Setting:\t160 Meas. Pts.\n\n"
    "Meas. Pts.\tTime\tShear Rate\tShear Stress\tViscosity\tTorque\tStatus\n"
    "\t[s]\t[1/s]\t[Pa]\t[Pa·s]\t[µNm]\t[]\n"
)
COMPASS_DE = (
    "Projekt:\tFliess\nTest:\tT1\n\nErgebnis:\tFließkurve 1\n\nAbschnitt und Messpunkte:\t1\t160\n"
    "Abschnittsdaten:\tPunkt Nr.\tZeit\tScherrate\tSchubspannung\tViskosität\n\t\t\t\t\t\n"
    "\t\t[s]\t[1/s]\t[Pa]\t[mPa·s]\n"
)
RHEOWIN = "HAAKE RheoWin 4.86\nFile name: a.rwd\nSubstance: gel\n\n;t in s;GP in 1/s;Tau in Pa;Eta in Pas\n"
QUANTUM = (
    "[Header]\n; comment\nTITLE,a\nFILEOPENTIME,3689.1,11/05/2020,10:00 am\nBYAPP,{},1.0\n"
    "INFO,12.3,SAMPLE_MASS\nINFO,,SAMPLE_MATERIAL\nDATATYPE,TIME,1\n[Data]\n"
)
MPMS_OLD = (
    "Time,Comment,Field (Oe),Temperature (K),Long Moment (emu),Long Scan Std Dev,Long Algorithm,"
    "Long Reg Fit,Long Percent Error\n"
)
ACMS = "Comment,Time Stamp (sec),Temperature (K),Magnetic Field (Oe),M-DC (emu),M-Std.Dev. (emu)\n"
DYNACOOL = (
    "Comment,Time Stamp (sec),Temperature (K),Magnetic Field (Oe),Moment (emu),M. Std. Err. (emu),"
    "Transport Action,Averaging Time (sec),Frequency (Hz),Peak Amplitude (mm),Min. Temperature (K),"
    "Max. Temperature (K),Min. Field (Oe),Max. Field (Oe)\n"
)
ETO = (
    "Comment,Time Stamp (sec),Status (code),Temperature (K),Magnetic Field (Oe),Resistance Ch1 (Ohms),"
    "Resistance Std. Dev. Ch1 (Ohms),Phase Angle Ch1 (deg)\n"
)
MICROMAG_LOOP = (
    "MicroMag 2900/3900 Data File (Series 0015)\nHysteresis loop\nUnits of measure             cgs\n"
    "Averaging time             +1.0E-01\nNData                      160\n\n"
)
MICROMAG_0017 = (
    "MicroMag 2900/3900 Data File (Series 0017)\nDirect moment vs. field; Hysteresis loop\n\n"
    "INSTRUMENT\nConfiguration          VSM\nHardware version       0004\nUnits of measure       SI\n\n"
    "  Field (A/m),  Moment (Am²),  Adjusted Moment (Am²)\n"
)
AIXACCT = (
    "DynamicHysteresis\nTimestamp: 11/05/2020 10:00:00\n\nTable 1\nArea [mm2]: 1.0\nThickness [nm]: 200\n"
    "Hysteresis Amplitude [V]: 4\n\nTime [s]\tV+ [V]\tI1 [A]\tP1 [uC/cm2]\n"
)
RADIANT = (
    "Vision Data File\nSample: A\nArea (cm2): 0.01\n\nPoint\tTime (ms)\tDrive Voltage\t"
    "Field (kV/cm)\tMeasured Polarization (µC/cm²)\n"
)


def instruments() -> Mapping[str, Variant]:
    """Variants by instrument and what is particular about them."""
    flow = (T, RATE, STRESS)
    vsm = (NONE, STAMPS, [5.0] * N, FIELD, MOMENT, ERRORS)
    return {
        "Q800, names above the data": Variant(
            Q800 + table(T, TEMPERATURE, RATE, RATE, STRESS, sep="\t"),
            {"Stress (MPa)": "MPa", "Strain (%)": "%"}, "Time (min)", ("Stress (MPa)", "Strain (%)"),
            ".txt", "cp1252",
        ),
        "TRIOS, axial, strain ramp": Variant(
            TRIOS + "[step]\nStress / strain ramp - 1\nStep time\tStress\tStrain\tGap\n"
            "s\tMPa\t%\tmm\n" + table(T, STRESS, RATE, [1 - v / 100 for v in RATE], sep="\t"),
            {"Stress": "MPa", "Strain": "%"}, "Step time", ("Strain", "Stress"), ".txt",
        ),
        "TRIOS, German, decimal commas": Variant(
            "Dateiname\ta.tri\nGerätename\tHR30\n[step]\nFließrampe - 1\nSpannung\tScherrate\tViskosität\t"
            "Schrittzeit\nPa\t1/s\tPa.s\ts\n" + table(STRESS, RATE, ONES, T, sep="\t", comma=True),
            {"Spannung": "Pa", "Scherrate": "1/s"}, "Schrittzeit", ("Scherrate", "Spannung"), ".txt",
        ),
        "TRIOS, amplitude sweep": Variant(
            TRIOS + "[step]\nAmplitude sweep - 1\nOscillation strain\tStep time\tStorage modulus\t"
            "Loss modulus\tTan(delta)\tOscillation stress\n%\ts\tMPa\tMPa\t\tMPa\n"
            + table(RATE, T, *MODULI, ONES, STRESS, sep="\t"),
            {"Storage modulus": "MPa"}, "Step time", None, ".txt",
        ),
        "RHEOPLUS, text": Variant(
            RHEOPLUS + table(NUMBERS, *flow, ONES, RATE, ["Dy_"] * N, sep="\t"),
            {"Shear Rate": "1/s", "Shear Stress": "Pa"}, "Time", ("Shear Rate", "Shear Stress"), ".txt",
            "cp1252",
        ),
        "RheoCompass, German": Variant(
            COMPASS_DE + table(NONE, NUMBERS, *flow, ONES, sep="\t", comma=True),
            {"Scherrate": "1/s", "Schubspannung": "Pa"}, "Zeit", ("Scherrate", "Schubspannung"),
            encoding="utf-16",
        ),
        "Kinexus, French": Variant(
            "Nom de l'action;Temps (séquence)(s);Contrainte de cisaillement(Pa);"
            "Taux de cisaillement(s-¹)\n" + table(["Rampe"] * N, T, STRESS, RATE, sep=";", comma=True),
            {"Contrainte de cisaillement(Pa)": "Pa", "Taux de cisaillement(s-¹)": "s-¹"},
            "Temps (séquence)(s)",
            ("Taux de cisaillement(s-¹)", "Contrainte de cisaillement(Pa)"),
        ),
        "RheoWin": Variant(
            RHEOWIN + table([f"{k}|{k}" for k in NUMBERS], *flow, ONES, sep=";"),
            {"GP in 1/s": "1/s", "Tau in Pa": "Pa"}, "t in s", ("GP in 1/s", "Tau in Pa"), ".txt",
        ),
        "MPMS, longitudinal moment": Variant(
            QUANTUM.format("MPMS") + MPMS_OLD + table(STAMPS, NONE, FIELD, [5.0] * N, MOMENT, ERRORS,
                                                      ONES, [0.99] * N, ERRORS),
            {"Field (Oe)": "Oe", "Long Moment (emu)": "emu"}, "Time",
            ("Field (Oe)", "Long Moment (emu)"), ".dat",
        ),
        "PPMS, ACMS": Variant(
            QUANTUM.format("ACMS") + ACMS + table(*vsm),
            {"Magnetic Field (Oe)": "Oe", "M-DC (emu)": "emu"}, "Time Stamp (sec)",
            ("Magnetic Field (Oe)", "M-DC (emu)"), ".dat", "latin-1",
        ),
        "DynaCool VSM": Variant(
            QUANTUM.format("VSM") + DYNACOOL
            + table(*vsm, ONES, ONES, [40.0] * N, [2.0] * N, [4.99] * N, [5.01] * N, FIELD, FIELD),
            {"Magnetic Field (Oe)": "Oe", "Moment (emu)": "emu"}, "Time Stamp (sec)",
            ("Magnetic Field (Oe)", "Moment (emu)"), ".dat",
        ),
        "PPMS, transport": Variant(
            QUANTUM.format("ETO") + ETO
            + table(NONE, STAMPS, ONES, [5.0] * N, FIELD, MOMENT, ERRORS, ERRORS),
            {"Magnetic Field (Oe)": "Oe", "Resistance Ch1 (Ohms)": "Ohms"}, "Time Stamp (sec)",
            ("Magnetic Field (Oe)", "Resistance Ch1 (Ohms)"), ".dat",
        ),
        "MicroMag loop, cgs": Variant(
            MICROMAG_LOOP + table(FIELD, MOMENT, form="{:+.6E}") + "\nMicroMag 2900/3900 Data File ends\n",
            {"Field": "Oe", "Moment": "emu"}, None, ("Field", "Moment"), ".hys", "latin-1",
        ),
        "MicroMag loop, series 0017, adjusted moment": Variant(
            MICROMAG_0017 + table(FIELD, MOMENT, [0.98 * v for v in MOMENT], form="{:+.6E}"),
            {"Field (A/m)": "A/m", "Moment (Am²)": "Am²"}, None, ("Field (A/m)", "Moment (Am²)"), ".hys",
            "latin-1",
        ),
        "Lake Shore VSM, gauss": Variant(
            "Lake Shore Model 7410\nSample: A\nDate: 11/05/2020\n\nField(G)  Moment(emu)\n"
            + table(FIELD, MOMENT, sep="   "),
            {"Field(G)": "G", "Moment(emu)": "emu"}, None, ("Field(G)", "Moment(emu)"), ".txt",
        ),
        "Lake Shore 8600": Variant(
            "##HEADER\n##Software version,8600\n##DATA TABLE\n"
            "Step,Iteration,Segment,Field [Oe],Moment (m) [emu],Time Stamp [s],Temperature [K]\n"
            + table(ONES, NUMBERS, ONES, FIELD, MOMENT, T, [300.0] * N),
            {"Field [Oe]": "Oe", "Moment (m) [emu]": "emu"}, "Time Stamp [s]",
            ("Field [Oe]", "Moment (m) [emu]"),
        ),
        "B-H analyser": Variant(
            "H [A/m];B [T]\n" + table(FIELD, MOMENT, sep=";", comma=True),
            {"H [A/m]": "A/m", "B [T]": "T"}, None, ("H [A/m]", "B [T]"),
        ),
        "J over H of a magnet": Variant(
            "H (kA/m)\tJ (T)\tT (K)\n" + table(FIELD, MOMENT, [300.0] * N, sep="\t"),
            {"H (kA/m)": "kA/m", "J (T)": "T"}, None, ("H (kA/m)", "J (T)"),
        ),
        "magnetisation in amperes a metre": Variant(
            "time (s),H (kA/m),M (kA/m),T (K)\n" + table(T, FIELD, MOMENT, [300.0] * N),
            {"M (kA/m)": "kA/m"}, "time (s)", ("H (kA/m)", "M (kA/m)"),
        ),
        "polarisation, aixACCT": Variant(
            AIXACCT + table(T, FIELD, ERRORS, MOMENT, sep="\t"),
            {"V+ [V]": "V", "P1 [uC/cm2]": "uC/cm2"}, "Time [s]", ("V+ [V]", "P1 [uC/cm2]"), ".dat",
        ),
        "polarisation, Radiant": Variant(
            RADIANT + table(NUMBERS, T, FIELD, [v / 20 for v in FIELD], MOMENT, sep="\t"),
            {"Field (kV/cm)": "kV/cm", "Measured Polarization (µC/cm²)": "µC/cm²"}, "Time (ms)",
            ("Field (kV/cm)", "Measured Polarization (µC/cm²)"), ".txt", "cp1252",
        ),
        "settings without data, Lake Shore": Variant(
            "[Settings]\nInstrument,Lake Shore 7410\nField,100,Oe\nRamp,a,b\n", refused=True
        ),
    }  # fmt: skip
