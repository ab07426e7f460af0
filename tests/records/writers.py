"""One record of two signals in every format, written by the formats' own libraries or by their published layout."""

from __future__ import annotations

import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

#: Signals in units other than SI where a format has units.
Signals = dict[str, np.ndarray]


def csv(path: Path, t: np.ndarray, twist: np.ndarray, torque: np.ndarray) -> Any:
    table = np.column_stack([1e3 * t, np.degrees(twist), torque])
    np.savetxt(path, table, "%.17g", ",", header="time [ms],twist [deg],torque [N*m]", comments="")
    return path


def frame(path: Path, t: np.ndarray, twist: np.ndarray, torque: np.ndarray) -> Any:
    import pandas as pd

    made = pd.DataFrame({"time": t, "twist [deg]": np.degrees(twist), "torque": 1e3 * torque})
    made.attrs["units"] = {"torque": "mN*m"}
    return made


def dated(path: Path, t: np.ndarray, twist: np.ndarray, torque: np.ndarray) -> Any:
    import pandas as pd

    index = pd.Timestamp("2026-03-01 10:00", tz="Europe/Berlin") + pd.to_timedelta(np.round(1e9 * t), "ns")
    return frame(path, t, twist, torque).drop(columns="time").set_index(index)


def dataset(path: Path, t: np.ndarray, twist: np.ndarray, torque: np.ndarray) -> Any:
    import xarray as xr

    made = xr.Dataset({"twist": ("time", np.degrees(twist)), "torque": ("time", torque)}, {"time": 1e3 * t})
    made["twist"].attrs["units"], made["time"].attrs["units"] = "deg", "ms"
    return made


def parquet(path: Path, t: np.ndarray, twist: np.ndarray, torque: np.ndarray) -> Any:
    import pyarrow as pa
    import pyarrow.parquet as pq

    fields = [
        pa.field("time", pa.float64(), metadata={"unit": "ms"}),
        pa.field("twist [deg]", pa.float64()),
        pa.field("torque", pa.float64()),
        pa.field("remark", pa.string()),
    ]
    columns = [pa.array(1e3 * t), pa.array(np.degrees(twist)), pa.array(torque), pa.array(["good"] * len(t))]
    pq.write_table(pa.table(columns, pa.schema(fields)), path, row_group_size=500)
    return path


def parquet_of_pandas(path: Path, t: np.ndarray, twist: np.ndarray, torque: np.ndarray) -> Any:
    dated(path, t, twist, torque).to_parquet(path)
    return path


def mat(path: Path, t: np.ndarray, twist: np.ndarray, torque: np.ndarray) -> Any:
    """As ``to_eppanalysis.m`` writes a timetable."""
    from scipy.io import savemat

    table = {
        "kind": "timetable", "time": t[:, None], "values": np.column_stack([np.degrees(twist), torque]),
        "names": np.array([["twist", "torque"]], object), "units": np.array([["deg", "N*m"]], object),
    }  # fmt: skip
    savemat(path, {"eppanalysis": table}, do_compression=True)
    return path


def mat_vectors(path: Path, t: np.ndarray, twist: np.ndarray, torque: np.ndarray) -> Any:
    from scipy.io import savemat

    savemat(path, {"tout": t, "twist": twist, "loads": np.column_stack([0.0 * t, torque]), "gain": 3.0, "who": "bench"})
    return path


def mat_simulink(path: Path, t: np.ndarray, twist: np.ndarray, torque: np.ndarray) -> Any:
    """Simulink's "structure with time"."""
    from scipy.io import savemat

    signals = np.array(
        [(twist[:, None], "twist"), (torque[:, None], "torque")], [("values", object), ("label", object)]
    )
    savemat(path, {"run": {"time": t[:, None], "signals": signals}})
    return path


def mat73(path: Path, t: np.ndarray, twist: np.ndarray, torque: np.ndarray) -> Any:
    """As MATLAB keeps what ``to_eppanalysis.m`` writes in HDF5: transposed, texts as codes, cells as references."""
    import h5py

    def text(place: Any, name: str, value: str) -> Any:
        place[name] = np.array([[ord(c)] for c in value], np.uint16)
        place[name].attrs["MATLAB_class"] = np.bytes_("char")
        return place[name]

    with h5py.File(path, "w", userblock_size=512) as file:
        made = file.create_group("eppanalysis")
        made.attrs["MATLAB_class"] = np.bytes_("struct")
        text(made, "kind", "timetable")
        made["time"], made["values"] = t[None, :], np.stack([np.degrees(twist), torque])
        for field, values in (("names", ("twist", "torque")), ("units", ("deg", "N*m"))):
            references = [text(file, f"#refs#/{field}{i}", v).ref for i, v in enumerate(values)]
            made[field] = np.array([[r] for r in references], h5py.ref_dtype)
            made[field].attrs["MATLAB_class"] = np.bytes_("cell")
    with path.open("r+b") as stream:
        stream.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM")
    return path


def ulog(path: Path, t: np.ndarray, twist: np.ndarray, torque: np.ndarray) -> Any:
    """By the layout that PX4 publishes; each topic has times of its own."""

    def message(kind: bytes, data: bytes) -> bytes:
        return struct.pack("<HB", len(data), kind[0]) + data

    out = [b"\x55\x4c\x6f\x67\x01\x12\x35\x01" + struct.pack("<Q", 0), message(b"B", bytes(40))]
    for topic, field in (("shaft", "twist"), ("drive", "torque")):
        out.append(message(b"F", f"{topic}:uint64_t timestamp;double {field};float[2] spare;".encode()))
    for i, topic in enumerate(("shaft", "drive")):
        out.append(message(b"A", struct.pack("<BH", 0, i) + topic.encode()))
    for a, b, c in zip(np.round(1e6 * t).astype(int), twist, torque, strict=True):
        for i, value in enumerate((b, c)):
            out.append(message(b"D", struct.pack("<HQdff", i, a, value, 0.0, 0.0)))
    path.write_bytes(b"".join(out))
    return path


def bag(path: Path, t: np.ndarray, twist: np.ndarray, torque: np.ndarray, mcap: bool = False) -> Any:
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    types = get_typestore(Stores.ROS2_HUMBLE)
    text = (
        "std_msgs/Header header\nstring[] names\nuint8 state\nfloat64 twist\ngeometry_msgs/Vector3 load\nint16[3] raw\n"
    )
    types.register(get_types_from_msg(text, "bench_msgs/msg/Shaft"))
    Shaft, Header, Time, Vector = (
        types.types[name]
        for name in ("bench_msgs/msg/Shaft", "std_msgs/msg/Header", "builtin_interfaces/msg/Time",
                     "geometry_msgs/msg/Vector3")
    )  # fmt: skip
    begin = 1_750_000_000 * 10**9
    folder = path.with_suffix("")
    with Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP if mcap else StoragePlugin.SQLITE3) as writer:
        connection = writer.add_connection("/bench/shaft", Shaft.__msgtype__, typestore=types)
        jitter = np.random.default_rng(1).integers(0, 10**6, len(t))
        for a, b, c, late in zip(np.round(1e9 * t).astype(int), twist, torque, jitter, strict=True):
            stamp = begin + int(a)
            header = Header(Time(stamp // 10**9, stamp % 10**9), "shaft")
            made = Shaft(header, ["one", "three"], 3, b, Vector(0.0, 0.0, c), np.array([1, 2, 3], np.int16))
            writer.write(connection, stamp + int(late), types.serialize_cdr(made, Shaft.__msgtype__))
    return folder


def mcap(path: Path, t: np.ndarray, twist: np.ndarray, torque: np.ndarray) -> Any:
    return next(bag(path, t, twist, torque, mcap=True).glob("*.mcap"))


def mf4(path: Path, t: np.ndarray, twist: np.ndarray, torque: np.ndarray) -> Any:
    from asammdf import MDF, Signal

    with MDF(version="4.10") as made:
        made.append([
            Signal(np.degrees(twist), t, name="twist", unit="deg"),
            Signal(np.round(1e6 * torque).astype(np.int64), t, name="torque", unit="N*m",
                   conversion={"a": 1e-6, "b": 0.0}),
        ])  # fmt: skip
        made.save(path, overwrite=True)
    return path


#: By name: the ending, what writes it, and what the signals are called where that is not their name.
FORMATS: dict[str, tuple[str, Callable[..., Any], dict[str, tuple[str, str]]]] = {
    "CSV": ("csv", csv, {}),
    "DataFrame": ("", frame, {}),
    "DataFrame with dates": ("", dated, {}),
    "Dataset": ("", dataset, {}),
    "Parquet": ("parquet", parquet, {}),
    "Parquet of pandas": ("parquet", parquet_of_pandas, {}),
    "MAT 5, timetable": ("mat", mat, {}),
    "MAT 5, vectors": ("mat", mat_vectors, {"torque": ("loads[2]", "")}),
    "MAT 5, Simulink": ("mat", mat_simulink, {}),
    "MAT 7.3": ("mat", mat73, {}),
    "ULog": ("ulg", ulog, {}),
    "rosbag2": ("db3", bag, {"torque": ("load.z", "N*m"), "twist": ("twist", "")}),
    "MCAP": ("mcap", mcap, {"torque": ("load.z", "N*m"), "twist": ("twist", "")}),
    "MF4": ("mf4", mf4, {}),
}
