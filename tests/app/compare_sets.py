"""Compares grasp sets with h5py, not with the program that wrote them."""
import h5py
import numpy


def differences(one, other):
    """Datasets and attributes in which two sets differ; the version and what is about their making aside."""
    found = []

    def items(file):
        names = []
        file.visititems(lambda name, item: names.append(name) if not name.startswith("timings") else None)
        return names

    def same(a, b):
        a, b = numpy.asarray(a), numpy.asarray(b)
        return a.shape == b.shape and a.dtype == b.dtype and a.tobytes() == b.tobytes() if a.dtype != object else (
            a.tolist() == b.tolist())

    with h5py.File(one) as a, h5py.File(other) as b:
        if items(a) != items(b):
            return [f"{one} and {other} do not have the same datasets"]
        for name in ["/", *items(a)]:
            if isinstance(a[name], h5py.Dataset) and not same(a[name][()], b[name][()]):
                found.append(name)
            if set(a[name].attrs) != set(b[name].attrs):
                found.append(f"{name}@")
                continue
            found += [f"{name}@{key}" for key in a[name].attrs
                      if key not in ("created", "host", "set_version") and not same(a[name].attrs[key], b[name].attrs[key])]
    return found
