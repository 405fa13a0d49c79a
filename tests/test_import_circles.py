"""No module of a package imports itself by way of others; imports for type checking and within functions count."""

import graphlib

import grimp
import pytest


def order(graph):
    """Sort modules so that each stands behind those that it imports; raises CycleError where none can come first."""
    return list(
        graphlib.TopologicalSorter(
            {module: graph.find_modules_directly_imported_by(module) for module in graph.modules}
        ).static_order()
    )


@pytest.mark.parametrize("package", ["guidance", "sitl_mock"])
def test_no_module_imports_itself_by_way_of_others(package):
    graph = grimp.build_graph(package, cache_dir=None)
    assert set(order(graph)) == graph.modules


def test_a_circle_would_be_found():
    graph = grimp.ImportGraph()
    for importer, imported in (("a", "b"), ("b", "c"), ("c", "a"), ("c", "d")):
        graph.add_import(importer=importer, imported=imported)
    with pytest.raises(graphlib.CycleError) as caught:
        order(graph)
    assert {*caught.value.args[1]} == {"a", "b", "c"}
