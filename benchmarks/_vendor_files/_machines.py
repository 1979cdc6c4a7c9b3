"""Testing machines: what their programs export, in languages, separators and units of several labs."""

from collections.abc import Mapping

import numpy as np

from ._variant import ANSWER, DRIVE, TIME, N, Variant, head, table

T, F, X = TIME.tolist(), DRIVE.tolist(), ANSWER.tolist()
ONES, NONE = [1] * N, [""] * N
NUMBERS = list(range(1, N + 1))
TEMPERATURE = (23 + 0.1 * np.sin(TIME)).tolist()

WAVEMATRIX = head(
    "Total Time (s)", "Cycle Elapsed Time (s)", "Total Cycles", "Elapsed Cycles", "Step",
    '"Total Cycle Count(8800 (0,1) Waveform)"', '"Position(8800 (0,1):Position) (mm)"',
    '"Load(8800 (0,1):Load) (kN)"',
)  # fmt: skip
TRAPEZIUM = (
    '"Key word","","Product Name",""\n"Test File Name","a.xtak","Method File Name","m.xmak"\n'
    '"Report Date","2020/11/05","Test Date","2020/11/05"\n"Speed","1mm/min","Shape","Plate"\n\n'
)
GDS = (
    '"Filename:","C:\\a.gds"\n"Specimen diameter (mm):","38"\n"Initial Height (mm):","76"\n\n'
    '"Stage Number","Time since start of test (s)","Axial Displacement(mm)","Load Cell(kN)",'
    '"Radial Pressure(kPa)"\n'
)
RESULTS = (
    '"Results Table 1"\n,"Specimen label","Maximum Load","Modulus"\n,,"(N)","(MPa)"\n'
    '1,"A","4.00","12.30"\n\n"Results Table 2"\n'
)


def machines() -> Mapping[str, Variant]:
    """Variants by maker and what is particular about them."""
    return {
        "Bluehill, English, quoted": Variant(
            RESULTS + '"Time","Extension","Load"\n"(s)","(mm)","(N)"\n' + table(T, X, F, quote='"'),
            {"Extension": "mm", "Load": "N"}, "Time", ("Extension", "Load"),
        ),
        "Bluehill, Spanish, semicolons": Variant(
            "Tabla de resultados 1\n;Etiqueta;Máx. Carga\n;;(N)\n1;A;4,0\n\n"
            "Tiempo;Extensión;Carga\n(s);(mm);(kN)\n" + table(T, X, F, sep=";", comma=True),
            {"Extensión": "mm", "Carga": "kN"}, "Tiempo", ("Extensión", "Carga"), encoding="cp1252",
        ),
        "Bluehill, French, stress and strain": Variant(
            "Temps;Déplacement;Force;Contrainte de traction;Déformation en traction\n"
            "(s);(mm);(N);(MPa);(%)\n"
            + table(T, X, F, [v / 3 for v in F], [v * 2 for v in X], sep=";", comma=True),
            {"Force": "N", "Déplacement": "mm"}, "Temps", ("Force", "Déplacement"),
            encoding="utf-8-sig",
        ),
        "Bluehill, US units": Variant(
            "Time,Extension,Load\n(sec),(in),(lbf)\n" + table(T, X, F),
            {"Extension": "in", "Load": "lbf"}, "Time", ("Extension", "Load"),
        ),
        "Bluehill Universal, Japanese": Variant(
            "結果表 1\n,最大荷重\n,(N)\n1,4.0\n\n時間,変位,荷重\n(s),(mm),(N)\n" + table(T, X, F),
            {"変位": "mm", "荷重": "N"}, "時間", ("変位", "荷重"), encoding="shift_jis",
        ),
        "WaveMatrix": Variant(
            WAVEMATRIX + table(T, T, ONES, ONES, ONES, ONES, X, F),
            {"Position(8800 (0,1):Position) (mm)": "mm", "Load(8800 (0,1):Load) (kN)": "kN"},
            "Total Time (s)", ("Position(8800 (0,1):Position) (mm)", "Load(8800 (0,1):Load) (kN)"),
        ),
        "testXpert III, English, TRA": Variant(
            '"Specimen ID";"17"\n"Gauge length";50;"mm"\n"Pre-load";0.2;"N"\n'
            '"Test time";"Standard travel";"Standard force"\n"s";"mm";"N"\n' + table(T, X, F, sep=";"),
            {"Standard travel": "mm", "Standard force": "N"}, "Test time",
            ("Standard travel", "Standard force"), ".TRA",
        ),
        "testXpert II, German, units in the header": Variant(
            "Prüfzeit [s];Standardkraft [N];Dehnung (Standardweg) [%]\n"
            + table(T, F, X, sep=";", comma=True),
            {"Standardkraft [N]": "N", "Dehnung (Standardweg) [%]": "%"}, "Prüfzeit [s]",
            ("Standardkraft [N]", "Dehnung (Standardweg) [%]"), encoding="cp1252",
        ),
        "testXpert, several specimens beside one another": Variant(
            "Specimen 1;;;Specimen 2;;\nTest time;Travel;Force;Test time;Travel;Force\ns;mm;N;s;mm;N\n"
            + table(T, X, F, T, [1.1 * v for v in X], F, sep=";", comma=True),
            {"Travel": "mm", "Force": "N"}, "Test time", ("Travel", "Force"), rows=2 * N,
        ),
        "Trapezium X": Variant(
            TRAPEZIUM + '"1 _ 1","",""\n"Time","Force","Stroke"\n"sec","N","mm"\n'
            + table(T, F, X, quote='"'),
            {"Force": "N", "Stroke": "mm"}, "Time", ("Force", "Stroke"),
        ),
        "Trapezium X, Chinese, two specimens": Variant(
            "名称,a\n\n1 _ 1,,,1 _ 2,,\n时间,力,行程,时间,力,行程\n秒,牛,毫米,秒,牛,毫米\n"
            + table(T, F, X, T, F, [1.1 * v for v in X]),
            {"力": "牛", "行程": "毫米"}, "时间", ("力", "行程"), encoding="gb18030", rows=2 * N,
        ),
        "MTS 793, English": Variant(
            "MTS793|MPT|ENU|1|2|.|/|:|1|0|0|A\n\nOperator Information\t\t\tTime:\t24.7\tSec\n\n"
            "Data Acquisition\t\t\tTime:\t0.1\tSec\n"
            "Running Time\tAxial Displacement\tAxial Force\tAxial Segments\n"
            "Sec\tmm\tkN\tsegments\n" + table(T, X, F, ONES, sep="\t"),
            {"Axial Displacement": "mm", "Axial Force": "kN"}, "Running Time",
            ("Axial Displacement", "Axial Force"), ".dat",
        ),
        "MTS 793, US units, command beside feedback": Variant(
            "MTS793|BTW|ENU|1|2|.|/|:|1|0|0|A\n\nData Header:\tCycles\t\tTime:\t0.1\tSec\n"
            "Time\tAxial Displacement Command\tAxial Displacement\tAxial Force\n"
            "Sec\tin\tin\tlbf\n" + table(T, X, X, F, sep="\t"),
            {"Axial Displacement": "in", "Axial Force": "lbf"}, "Time",
            ("Axial Displacement", "Axial Force"), ".dat",
        ),
        "MTS TestSuite, strings in quotes": Variant(
            '"Axial Displacement (mm)","Axial Force (N)","Time (s)"\n' + table(X, F, T),
            {"Axial Displacement (mm)": "mm", "Axial Force (N)": "N"}, "Time (s)",
            ("Axial Displacement (mm)", "Axial Force (N)"),
        ),
        "TestWorks 4": Variant(
            "Sample ID:,a.mss\nSpecimen Number:,1\nTagged:,False\n\n"
            "Crosshead ,Load ,Time \nmm,N,sec\n" + table(X, F, T),
            {"Crosshead": "mm", "Load": "N"}, "Time", ("Crosshead", "Load"),
        ),
        "WinTest (ElectroForce)": Variant(
            "Bose WinTest\nGroup 1\n\nScan,Points,Elapsed Time,Disp,Load\n,,sec,mm,N\n"
            + table(ONES, NUMBERS, T, X, F),
            {"Disp": "mm", "Load": "N"}, "Elapsed Time", ("Disp", "Load"),
        ),
        "UniVert": Variant(
            "Cycle,Time_S,Size_mm,Displacement_mm,Force_N,Temperature_C\n"
            + table(ONES, T, [10 + v for v in X], X, F, TEMPERATURE),
            {"Displacement_mm": "mm", "Force_N": "N"}, "Time_S", ("Displacement_mm", "Force_N"),
        ),
        "MESURgauge": Variant(
            "Reading\tLoad [lbF]\tTravel [in]\tTime [sec.]\n" + table(NUMBERS, F, X, T, sep="\t"),
            {"Load [lbF]": "lbF", "Travel [in]": "in"}, "Time [sec.]", ("Load [lbF]", "Travel [in]"),
            ".txt",
        ),
        "NexygenPlus": Variant(
            "Test Name: foam\nSpeed: 10 mm/min\n\nLoad (N),Extension from Preload (mm),"
            "Machine Extension (mm),Time (s)\n" + table(F, X, [v + 0.3 for v in X], T),
            {"Load (N)": "N"}, "Time (s)", ("Load (N)", "Extension from Preload (mm)"),
        ),
        "Horizon, stress and strain alone": Variant(
            "Position (mm),Force (N),Stress (MPa),Strain (%)\n"
            + table(X, F, [v / 3 for v in F], [v * 2 for v in X]),
            {"Position (mm)": "mm", "Force (N)": "N"}, None, ("Position (mm)", "Force (N)"),
        ),
        "GDS triaxial cell": Variant(
            GDS + table(ONES, T, X, F, [100.0] * N),
            {"Axial Displacement(mm)": "mm", "Load Cell(kN)": "kN"}, "Time since start of test (s)",
            ("Axial Displacement(mm)", "Load Cell(kN)"),
        ),
        "structures, kips and inches": Variant(
            "Step\tDisp (in.)\tBase Shear (kips)\n" + table(NUMBERS, X, F, sep="\t"),
            {"Disp (in.)": "in.", "Base Shear (kips)": "kips"}, None,
            ("Disp (in.)", "Base Shear (kips)"), ".txt",
        ),
        "names over a slash": Variant(
            "Zeit / s;Kraft / N;Weg / mm\n" + table(T, F, X, sep=";", comma=True),
            {"Kraft / N": "N", "Weg / mm": "mm"}, "Zeit / s", ("Kraft / N", "Weg / mm"),
            encoding="cp1252",
        ),
        "names with in": Variant(
            "Zeit in s\tKraft in kN\tWeg in mm\n" + table(T, F, X, sep="\t", comma=True),
            {"Kraft in kN": "kN", "Weg in mm": "mm"}, "Zeit in s", ("Kraft in kN", "Weg in mm"),
        ),
        "names with a comma, Russian": Variant(
            "Время, с;Нагрузка, кН;Перемещение, мм\n" + table(T, F, X, sep=";", comma=True),
            {"Нагрузка, кН": "кН", "Перемещение, мм": "мм"}, "Время, с",
            ("Нагрузка, кН", "Перемещение, мм"), encoding="cp1251",
        ),
        "Italian, semicolons": Variant(
            "Prova;1\nData;12/05/2022\n\nTempo;Forza;Spostamento\ns;N;mm\n"
            + table(T, F, X, sep=";", comma=True),
            {"Forza": "N", "Spostamento": "mm"}, "Tempo", ("Forza", "Spostamento"),
        ),
        "Czech": Variant(
            "Čas [s];Síla [N];Dráha [mm]\n" + table(T, F, X, sep=";", comma=True),
            {"Síla [N]": "N", "Dráha [mm]": "mm"}, "Čas [s]", ("Síla [N]", "Dráha [mm]"),
            encoding="cp1250",
        ),
        "Hungarian": Variant(
            "Idő (s);Erő (N);Elmozdulás (mm)\n" + table(T, F, X, sep=";", comma=True),
            {"Erő (N)": "N", "Elmozdulás (mm)": "mm"}, "Idő (s)", ("Erő (N)", "Elmozdulás (mm)"),
            encoding="cp1250",
        ),
        "Korean": Variant(
            "시간(s),하중(N),변위(mm)\n" + table(T, F, X),
            {"하중(N)": "N", "변위(mm)": "mm"}, "시간(s)", ("하중(N)", "변위(mm)"), encoding="euc_kr",
        ),
        "TriboScan": Variant(
            "\nNumber of Points = 160\n\nDepth (nm)\tLoad (µN)\tTime (s)\tDepth (V)\tLoad (V)\n"
            + table(X, F, T, [v / 9 for v in X], [v / 7 for v in F], sep="\t"),
            {"Depth (nm)": "nm", "Load (µN)": "µN"}, "Time (s)", ("Depth (nm)", "Load (µN)"),
            ".txt", "cp1252",
        ),
        "Piuma": Variant(
            "Date\t05/11/2020\nTip radius (um)\t25.5\nStiffness (N/m)\t0.45\n\n"
            "Time (s)\tLoad (uN)\tIndentation (nm)\tCantilever (nm)\tPiezo (nm)\tAuxiliary\n"
            + table(T, F, X, [v / 3 for v in F], [v + w / 3 for v, w in zip(X, F, strict=True)], NONE,
                    sep="\t"),
            {"Load (uN)": "uN", "Indentation (nm)": "nm"}, "Time (s)",
            ("Load (uN)", "Indentation (nm)"), ".txt",
        ),
        "texture analyser, several curves, kilograms": Variant(
            "foam1\tfoam1\tfoam1\tfoam2\tfoam2\tfoam2\nForce\tDistance\tTime\tForce\tDistance\tTime\n"
            "kg\tmm\tsec\tkg\tmm\tsec\n\n" + table(F, X, T, F, [1.1 * v for v in X], T, sep="\t"),
            {"Force": "kg", "Distance": "mm"}, "Time", ("Force", "Distance"), ".TAB", rows=2 * N,
        ),
        "texture analyser, units in brackets, decimal commas": Variant(
            "Time (sec);Distance (mm);Force (g)\n" + table(T, X, F, sep=";", comma=True),
            {"Force (g)": "g", "Distance (mm)": "mm"}, "Time (sec)", ("Force (g)", "Distance (mm)"),
        ),
        "a strain gauge, microstrain": Variant(
            "Time (s),Load (kN),Strain (µε)\n" + table(T, F, X),
            {"Load (kN)": "kN", "Strain (µε)": "µε"}, "Time (s)", ("Load (kN)", "Strain (µε)"),
        ),
        "French, decanewtons": Variant(
            "Temps (s);Effort (daN);Course (mm)\n" + table(T, F, X, sep=";", comma=True),
            {"Effort (daN)": "daN"}, "Temps (s)", ("Effort (daN)", "Course (mm)"), encoding="cp1252",
        ),
        "nanoindenter, units below": Variant(
            "Displacement Into Surface\tLoad On Sample\tTime On Sample\nnm\tmN\ts\n"
            + table(X, F, T, sep="\t"),
            {"Displacement Into Surface": "nm", "Load On Sample": "mN"}, "Time On Sample",
            ("Displacement Into Surface", "Load On Sample"), ".txt",
        ),
        "a damper with its velocity": Variant(
            "Time (s),Displacement (mm),Velocity (mm/s),Force (N)\n"
            + table(T, F, np.gradient(DRIVE, 0.05).tolist(), X),
            {"Force (N)": "N"}, "Time (s)", ("Displacement (mm)", "Force (N)"),
        ),
        "torque and twist": Variant(
            "Time (s),Rotation (deg),Torque (N-m)\n" + table(T, X, F),
            {"Rotation (deg)": "deg", "Torque (N-m)": "N-m"}, "Time (s)",
            ("Rotation (deg)", "Torque (N-m)"),
        ),
    }  # fmt: skip
