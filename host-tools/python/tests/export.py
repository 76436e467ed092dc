"""Exports against those of `plumb`, byte by byte."""

import pathlib

import plumbline

trial = plumbline.open_trial("trials/p02-foam")
for format in ("csv", "parquet", "trc", "c3d"):
    # A TRC names itself.
    ours, theirs = (pathlib.Path(maker, f"p02.{format}") for maker in ("python", "plumb"))
    exported = trial.export(format, ours)
    assert exported.rows == 1800 and abs(exported.rate_hz - 60) < 0.1
    assert exported.zero == 'the mark "stands"' and isinstance(exported.warnings, list)
    assert ours.read_bytes() == theirs.read_bytes(), format
    try:
        trial.export(format, ours)
    except plumbline.BadInput as error:
        assert error.place == str(ours) and error.remedy
    else:
        raise AssertionError("a file was replaced")
    trial.export(format, ours, force=True)
trial.export("bids", "python/bids", session="week4", run=2)


def files(folder):
    return {path.relative_to(folder): path.read_bytes()
            for path in sorted(pathlib.Path(folder).rglob("*")) if path.is_file()}


ours, theirs = files("python/bids"), files("plumb/bids")
assert len(ours) > 5 and ours == theirs
