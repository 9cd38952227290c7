"""Files of which a part is missing: the middle of a number, or the rest of a scan."""

import pytest

from gonio.data.formats.csv.table_file import read_csv


@pytest.mark.parametrize("kept", [8 * 5 - 1, 8 * 4 + 1, 8 * 3 + 3])
def test_a_scan_whose_last_run_ends_early_is_said(tmp_path, kept):
    """Runs over the azimuth at each detector's polar angle; a file without its last run is a whole one."""
    rows = [f"30,0,{theta_o},{turn},0.2" for theta_o in range(0, 50, 10) for turn in range(0, 360, 45)]
    warnings = {}
    for name, some in {"cut": rows[:kept], "shorter": rows[: 8 * (kept // 8)], "turned": rows[kept::-1]}.items():
        (tmp_path / f"{name}.csv").write_text("\n".join(["theta_i,phi_i,theta_o,phi_o,f", *some, ""]))
        warnings[name] = read_csv(tmp_path / f"{name}.csv").provenance.get("warnings", [])
    assert "ends after" in warnings["cut"][0] and not any("ends after" in w for w in warnings["shorter"])
    assert not any("ends after" in w for w in warnings["turned"])
