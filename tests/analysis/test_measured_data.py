"""Files of measured data as spreadsheets and data loggers write them."""

import numpy as np
import pandas as pd
import pytest
from numpy.testing import assert_allclose

import beamdae as bd
from beamdae.analysis.fit.data import match_columns, read_fit_data, read_measurements
from beamdae.model_parameters import split_unit, standardize_header
from beamdae.results.columns import Header, remove_unit

ACCEPTED = {
    "plain": "t [s],tip.y [mm]\n0,1.5\n0.1,2.5\n",
    "parentheses": "t (s),tip.y (mm)\n0,1.5\n0.1,2.5\n",
    "no space": "t[s],tip.y[mm]\n0,1.5\n0.1,2.5\n",
    "another unit of time": "Time (ms),tip.y [mm]\n0,1.5\n100,2.5\n",
    "semicolons": "t [s];tip.y [mm]\n0;1.5\n0.1;2.5\n",
    "decimal commas": "t [s];tip.y [mm]\n0;1,5\n0,1;2,5\n",
    "tabs and decimal commas": "t [s]\ttip.y [mm]\n0\t1,5\n0,1\t2,5\n",
    "separator line": "sep=;\nt [s];tip.y [mm]\n0;1,5\n0,1;2,5\n",
    "Windows line ends": "t [s],tip.y [mm]\r\n0,1.5\r\n0.1,2.5\r\n",
    "byte-order mark": "\ufefft [s],tip.y [mm]\n0,1.5\n0.1,2.5\n",
    "comments": "# rig 3\n% 4 kHz\n// raw\nt [s],tip.y [mm]\n0,1.5\n# stop\n0.1,2.5\n",
    "empty column": "t [s],tip.y [mm],\n0,1.5,\n0.1,2.5,\n",
    "separators at line ends": "t [s],tip.y [mm]\n0,1.5,\n0.1,2.5,\n",
    "empty rows": "t [s],tip.y [mm]\n0,1.5\n,\n\nNaN,nan\n0.1,2.5\n,\n",
    "separator line of tabs": "sep=\t\nt [s]\ttip.y [mm]\n0\t1,5\n0,1\t2,5\n",
    "header in a comment": "# rig 3\n# t [s],tip.y [mm]\n0.0e+00,1.5\n1e-1,2.5\n",
    "experiments that look like numbers": (
        "experiment;observable;t [s];value\n1.5;tip.y [mm];0;1,5\n1.5;tip.y [mm];0,1;2,5\n"
    ),
    "rows in any order": "t [s],tip.y [mm]\n0.1,2.5\n0,1.5\n",
    "quotes": '"t [s]","tip.y [mm]"\n"0","1.5"\n"0.1","2.5"\n',
    "long table": "observable;t (ms);value;sigma\ntip.y (mm);0;1,5;1\ntip.y (mm);100;2,5;1\n",
    "LabVIEW": (
        "LabVIEW Measurement\t\nSeparator\tTab\nDecimal_Separator\t,\nDate\t2011/11/17\n"
        "***End_of_Header***\t\n\t\nSamples\t2\t\nX0\t0,0\t\nTime\ttip.y [mm]\t\n"
        "0,0\t1,5\n0,1\t2,5\n"
    ),
    "Catman": "CATMAN file\t2\nSR: 10 Hz\tSR: 10 Hz\nTime\ttip.y\ns\tmm\n0,0\t1,5\n0,1\t2,5\n",
    "padded lines of a spreadsheet": (
        "Title,,\nOperator,Smith,\n,,\nt,tip.y,\n[s],[mm],\n0,1.5,\n0.1,2.5,\n"
    ),
    "oscilloscope": "Model,X 20\nPoints,2\nTime (s),tip.y (mm)\n0.0E+00,1.5\n1.0E-01,2.5\n",
    "units below a header in a comment": "# rig 3\n# t,tip.y\n# s,mm\n0,1.5\n0.1,2.5\n",
    **{
        f"time stamps as {first}": f"rig;3\nTime;tip.y [mm]\n{first};1.5\n{second};2.5\n"
        for first, second in [
            ("2011-11-17 21:25:10,000", "2011-11-17 21:25:10,100"),
            ("2011-11-17T21:25:10.9Z", "2011-11-17T22:25:11+01:00"),
            ("2011-11-17T10:55:10.9-10:30", "2011-11-17T21:25:11Z"),
            ("17.11.2011 23:59:59.9", "18.11.2011 00:00:00"),
            ("11/17/2011 9:25:10.0 PM", "11/17/2011 9:25:10.1 PM"),
            ("01/02/2011 9:25:10.0", "01/02/2011 9:25:10.1"),
            ("17-Nov-2011 21:25:10:000", "17-Nov-2011 21:25:10:100"),
            ("23:59:59.9", "00:00:00.0"),
            ("25:10,9", "25:11,0"),
        ]
    },
}
REJECTED = {
    "before the trigger": ("t [s],y [m]\n-0.1,1\n0,2\n", "got -0.1 s in row 1; remove the rows"),
    "missing time": ("t [s],y [m]\n0,1\n,3\n0.1,2\n", "but row 2 has no time"),
    "repeated": ("t [s],y [m]\n0.1,1\n0,2\n,\n0.1,2\n", r"got 0\.1 s again in row 4; average"),
    "text between rows": ("t [s],y [m]\n0,1\nt [s],y [m]\n0,1\n1,2\n", r"got 't \[s\]' in row 2"),
    "order of day and month": (
        "t,y [m]\n01/02/2011 10:00,1\n02/02/2011 10:00,2\n",
        "the order of day and month in the time stamps of 't' of .* is ambiguous; write dates as 2",
    ),
    "spaces": ("t y\n0 1\n", "no separators of columns in its header 't y'"),
    "decimal and column commas": ("t [s],y [m]\n0,0,1,5\n", "more cells than the header"),
    "excess empty cells": ("t [s],x [m],y [m],z\n0,5,1,2,,\n", "row 1 has more cells than"),
    "truth values": (
        "t [s],y [m]\n0,True\n0.1,False\n",
        "column 'y .m.' of .* must contain finite numbers",
    ),
    "points and commas": ("t [s];y [m]\n0.5;1,5\n", "the numbers 1,5 and 0.5"),
    "thousands": ("t [s];y [m]\n0;1.234,5\n", "numbers or NaN, got '1.234,5' in row 1"),
    "numbers only": ("0,1\n1,2\n", "has no header; write a first line such as 't .s.,force"),
    "no header": ("t [s],y [m],\n0,1,2\n", "column 3 has values but no header"),
    "repeated header": ("t [s],y (m),y [m]\n0,1,2\n", r"the column 'y \[m\]' twice"),
    "empty": ("# nothing\n\n", "is empty"),
    "bytes": ("\0\1,\2\n", "not a text file"),
}


def read_columns(data, observed=None, sigma=None, names=None):
    """Return the long table of each column of a fit, by default in the units of the data."""
    measured = read_measurements("fit", data, names)
    observed = list(measured.names.values()) if observed is None else observed
    headers = dict.fromkeys(measured.experiments, observed)
    table = read_fit_data(measured, headers, sigma).table
    return {str(x): rows for x, rows in table.groupby("column", sort=False)}


def assert_column(columns, header, times, values=None):
    assert list(columns) == [header]
    assert_allclose(columns[header]["t [s]"], times, rtol=1e-12)
    if values is not None:
        assert_allclose(columns[header]["value"], values, rtol=1e-14)


@pytest.fixture
def write(tmp_path):
    def write(text, encoding="utf-8"):
        path = tmp_path / "data.csv"
        path.write_bytes(text.encode(encoding))
        return path

    return write


@pytest.mark.parametrize("text", ACCEPTED.values(), ids=ACCEPTED)
def test_regression_usual_files_are_read(write, text):
    """Other separators, units in parentheses, empty rows and columns were rejected."""
    assert_column(read_columns(write(text)), "tip.y [mm]", [0.0, 0.1], [1.5, 2.5])


@pytest.mark.parametrize("encoding", ["utf-16", "latin-1"])
def test_other_encodings_are_read(write, encoding):
    columns = read_columns(write("t [s]\ttip.y [µm]\n0\t1\n1\t2\n", encoding))
    assert_column(columns, "tip.y [µm]", [0.0, 1.0], [1.0, 2.0])


@pytest.mark.parametrize(("text", "message"), REJECTED.values(), ids=REJECTED)
def test_regression_other_files_are_rejected_with_the_reason(write, text, message):
    with pytest.raises(bd.BeamdaeError, match=f"^fit: .*{message}"):
        read_columns(write(text))


@pytest.mark.parametrize("header", ["t", "Time"])
def test_regression_times_without_a_unit_are_seconds_with_a_warning(write, header):
    """The columns t and time were rejected in wide tables, and had no warning in long ones."""
    message = f"the times '{header}' of .* have no unit and are taken as seconds; name the column"
    for text in (
        f"{header},y [m]\n0,1\n0.5,2\n",
        f"{header},observable,value\n0,y [m],1\n0.5,y [m],2\n",
    ):
        with pytest.warns(bd.BeamdaeWarning, match=message):
            columns = read_columns(write(text))
        assert_column(columns, "y [m]", [0.0, 0.5])


def test_regression_accelerations_may_be_in_g():
    """The unit was known as gram only."""
    data = {"t [s]": [0.0, 1.0], "tip.x_ddot [g]": [1.0, 2.0], "tip.y_ddot [mg]": [1.0, 2.0]}
    columns = read_columns(data, ["tip.x_ddot [m/s^2]", "tip.y_ddot [m/s^2]"], 1.0)
    for column, factor in zip(columns.values(), (9.80665, 9.80665e-3), strict=True):
        assert_allclose(column["value"], [factor, 2.0 * factor], rtol=1e-14)
    with pytest.raises(bd.BeamdaeError, match=r"is in kn \(did you mean 'kN'\?\), but the model o"):
        read_columns({"t [s]": [0.0], "F [kn]": [1.0]}, ["F [N]"])


def test_regression_strains_may_be_in_microstrain_and_times_name_their_unit():
    data = {"t [s]": [0.0, 1.0], "gauge [microstrain]": [100.0, 200.0], "top (ppm)": [1.0, 2.0]}
    columns = read_columns(data, ["gauge [-]", "top [-]"], 1.0).values()
    assert_allclose([x["value"] for x in columns], [[1e-4, 2e-4], [1e-6, 2e-6]], rtol=1e-14)
    with pytest.raises(bd.BeamdaeError, match=r"must contain the column 't \[s\]'"):
        read_columns({"t (Milliseconds)": [0.0, 1.0], "gauge": [1.0, 2.0]})


def test_time_stamps_of_tables_in_memory_are_read():
    times = pd.to_datetime(["2024-05-31 10:00:00.0", None, "2024-05-31 10:00:00.1"])
    message = "the first time stamp of 't' of data, 2024-05-31.10:00:00.*, is taken as 0 s; if the"
    for stamps in (times, times.tz_localize("Europe/Berlin"), times.to_pydatetime()):
        with pytest.warns(bd.BeamdaeWarning, match=message):
            columns = read_columns(pd.DataFrame({"t": stamps, "y [m]": [1.0, np.nan, 2.0]}))
        assert_column(columns, "y [m]", [0.0, 0.1])


def test_tables_in_memory_may_have_units_in_parentheses():
    table = {"t (ms)": [0.0, np.nan, 100.0], "tip.y (mm)": [1.5, np.nan, 2.5]}
    for data in (table, pd.DataFrame(table)):
        assert_column(read_columns(data), "tip.y [mm]", [0.0, 0.1])
    (column,) = read_columns({"run (m)": table}).values()
    assert set(column["experiment"]) == {"run (m)"}


def test_one_law_splits_headers():
    for header, name, unit in [
        ("tip.y [mm]", "tip.y", "mm"),
        ("a [b] [N/(m s)]", "a [b]", "N/(m s)"),
        ("tip.y", "tip.y", ""),
        ("tip [left", "tip [left", ""),
        ("[m]", "[m]", ""),
    ]:
        assert split_unit(header) == (name, unit)
        assert (remove_unit(header), Header.of(header).unit) == (name, unit)
        assert standardize_header(header) == header
    assert standardize_header(" gauge (left)") == "gauge (left)"
    # "min" is often a minimum.
    assert standardize_header("force (min)") == "force (min)"
    assert standardize_header("t (min)") == "t [min]"
    assert standardize_header("gauge (left) (N/m)") == "gauge (left) [N/m]"
    assert standardize_header("d(tip.y)/d(E)") == "d(tip.y)/d(E)"


@pytest.mark.parametrize("name", ["tip.y", "tip.y [mm]", "tip.y (mm)"])
def test_regression_sigma_may_omit_the_unit_of_the_column(name):
    """The keys had to be the headers of the data, and the values numbers."""
    data = {"t [s]": [0.0, 1.0], "tip.y (mm)": [1.0, 2.0], "tip.x [m]": [1.0, 2.0]}
    y, x = read_columns(data, sigma={name: "20 µm", "tip.x": 0.5}).values()
    assert_allclose((y["sigma"], x["sigma"]), ([0.02, 0.02], [0.5, 0.5]), rtol=1e-12)
    with pytest.raises(
        bd.BeamdaeError, match=r"^fit: sigma must name the observed columns of data, tip\.y \[mm\]"
    ):
        read_columns(data, sigma={name: 1.0})
    with pytest.raises(bd.BeamdaeError, match=r"sigma of tip\.y.*measures another quantity"):
        read_columns(data, sigma={name: "2 s", "tip.x": 0.5})
    plain = {"t [s]": [0.0, 1.0], "tip.y": [1.0, 2.0]}
    (column,) = read_columns(plain, ["tip.y [m]"], sigma="2 mm").values()
    assert_allclose(column["sigma"], 2e-3)


def test_plots_read_the_same_files(write):
    data = write("t (ms);tip.y (mm);remark\n0;1,5;start\n100;2,5;\n")
    matched, unknown = match_columns("plot", read_measurements("plot", data), {"": ["tip.y [m]"]})
    assert list(matched.table["value"]) == [1.5e-3, 2.5e-3]
    assert unknown == ["'remark'"]


def test_regression_fits_omit_columns_that_the_model_does_not_observe(write):
    """sigma was required for the other column, then the column was rejected, then its texts."""
    data = write("t [s],tip.y [mm],gauge [V],remark\n0,1,5,start\n0.1,2,6,\n")
    observed = ["tip.x [m]", "tip.y [m]"]
    # Tables of runs contain energies, which are not observed.
    omitted = r"'gauge \[V\]', 'remark', which the model does not observe and fit omits"
    with pytest.warns(bd.BeamdaeWarning, match=rf"^fit: .* contains {omitted}"):
        columns = read_columns(data, observed)
    assert_column(columns, "tip.y [m]", [0.0, 0.1], [1e-3, 2e-3])
    with pytest.raises(bd.BeamdaeError, match=r"sigma must name the observed columns of data, tip"):
        read_columns(data, observed, {"tip.y": 1.0, "gauge": 1.0})
    for header, hint in [
        ("tip.z [mm]", r"got 'tip\.z \[mm\]' \(did you mean 'tip\.[xy]'\?\), 'remark'; name them"),
        ("tip", r"got 'tip' \(name one of tip\.x \[m\], tip\.y \[m\]\), 'remark'; name them as in"),
    ]:
        data = write(f"t [s],{header},remark\n0,1,start\n0.1,2,\n")
        with pytest.raises(bd.BeamdaeError, match=hint):
            read_columns(data, observed)


def test_values_without_a_time_in_other_columns_are_ignored(write):
    data = write("t [s],tip.y [m],room [K]\n0,1,5\n,,6\n0.1,2,\n")
    measured = read_measurements("plot", data)
    assert len(match_columns("plot", measured, {"": ["tip.y [m]"]})[0].table) == 2
    with pytest.raises(bd.BeamdaeError, match="but row 2 has no time"):
        match_columns("plot", measured, {"": ["room [K]"]})


def test_regression_long_files_are_rejected_not_cut(write, monkeypatch):
    """Rows beyond the limit were not read, without an error if columns had gaps."""
    monkeypatch.setattr("beamdae.analysis.fit.data._MAX_DATA", 4)
    gaps = "".join(f"{k},{k if k % 2 else ''}\n" for k in range(6))
    with pytest.raises(bd.BeamdaeError, match=r"data.csv has 6 rows, more than 4; average or omit"):
        read_columns(write("t [s],y [m]\n" + gaps))


@pytest.mark.parametrize(
    ("unit", "sigma", "expected"),
    [
        ("g", "1 gn", 9.80665),
        ("g", "9.80665 m/s^2", 9.80665),
        ("g", "1g", 9.80665),
        ("g", "20 mg", 0.196133),
        ("g", 0.3, 2.941995),
        ("mg", "1 g", 9.80665),
        ("gn", "9.80665 m/s^2", 9.80665),
    ],
)
def test_regression_sigma_of_accelerations_in_gravities_has_units(unit, sigma, expected):
    """The units gn and m/s^2 were said to measure another quantity than g."""
    data = {"t [s]": [0.0, 1.0], f"tip.y_ddot [{unit}]": [1.0, 2.0]}
    (column,) = read_columns(data, ["tip.y_ddot [m/s^2]"], sigma=sigma).values()
    assert_allclose(column["sigma"], expected)


@pytest.mark.parametrize(
    ("header", "columns", "values"),
    [
        ("Zeit [ms],Laser [mm]", {"Zeit": "t", "Laser": "tip.y"}, [1e-3, 2e-3]),
        ("Zeit (ms),Laser (mm)", {"Zeit (ms)": "t [s]", "Laser (mm)": "tip.y [m]"}, [1e-3, 2e-3]),
        ("Zeit,Laser", {"Zeit": "t [ms]", "Laser": "tip.y [mm]"}, [1e-3, 2e-3]),
        ("t [ms],tip.x [m]", {"tip.x": "tip.y"}, [1.0, 2.0]),
    ],
)
def test_columns_of_data_may_have_other_names(write, header, columns, values):
    data = write(f"{header}\n0,1\n100,2\n")
    fitted = read_columns(data, ["tip.x [m]", "tip.y [m]"], names=columns)
    assert_column(fitted, "tip.y [m]", [0.0, 0.1], values)


def test_observables_of_long_tables_may_have_other_names():
    table = {"observable": ["Laser [mm]", "Laser [mm]"], "Zeit [ms]": [0, 100], "value": [1, 2]}
    columns = {"Laser": "tip.y", "Zeit": "t"}
    fitted = read_columns(table, ["tip.y [m]"], names=columns)
    assert_column(fitted, "tip.y [m]", [0.0, 0.1], [1e-3, 2e-3])


@pytest.mark.parametrize(
    ("columns", "message"),
    [
        ({"Lasr": "tip.y"}, r"data_columns contains 'Lasr', which is not a column of data"),
        (
            {"Laser": "tip.z"},
            r"maps 'Laser \[mm\]' to 'tip.z \[mm\]' \(did you mean 'tip.y'\?\), w",
        ),
        ({"Laser": "tip.y", "other": "tip.y"}, "'Laser .mm.' and 'other' of data are the same"),
        ({"Laser": "t"}, r"maps 'Laser \[mm\]' to 't \[mm\]', which is not a column of the run"),
        ({"other": "t [ms]"}, "'t .s.' and 'other' of data are both times; remove one"),
        ({"Laser": 3}, "data_columns must be a dict of names of columns of the run by names in"),
        ("tip.y", "data_columns must be a dict of names of columns of the run by names in data"),
        ({}, r"must contain .*, or map them, as with data_columns=\{'Laser \[mm\]': 'tip.y'\}"),
    ],
)
def test_wrong_names_of_columns_are_named(columns, message):
    data = {"t [s]": [0.0, 0.1], "Laser [mm]": [1.0, 2.0], "other": [1.0, 2.0]}
    with pytest.raises(bd.BeamdaeError, match=message):
        read_columns(data, ["tip.y [m]", "a.angle [rad]"], names=columns)


def test_times_of_another_name_are_suggested():
    with pytest.raises(bd.BeamdaeError, match=r"as with data_columns=\{'Zeit \[ms\]': 't'\}\.$"):
        read_measurements("fit", {"Laser [mm]": [1.0, 2.0], "Zeit [ms]": [0.0, 100.0]})
