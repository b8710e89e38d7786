"""Directed graphs: orders, cycles, and distances from the first nodes."""

from __future__ import annotations

import heapq
from collections import deque
from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from graphlib import CycleError, TopologicalSorter
from typing import TypeVar

import numpy as np

N = TypeVar("N", bound=Hashable)


def _sorter(nodes: Sequence[N], edges: Iterable[tuple[N, N]]) -> TopologicalSorter[N]:
    graph = TopologicalSorter(dict.fromkeys(nodes, ()))
    for a, b in edges:
        graph.add(b, a)
    return graph


def topological(nodes: Sequence[N], edges: Iterable[tuple[N, N]]) -> list[N]:
    """Order the nodes of an acyclic graph; ties stay in the given order."""
    rank = {node: i for i, node in enumerate(nodes)}
    graph = _sorter(nodes, edges)
    graph.prepare()
    ready: list[int] = []
    order: list[N] = []
    while graph.is_active():
        for node in graph.get_ready():
            heapq.heappush(ready, rank[node])
        order.append(nodes[heapq.heappop(ready)])
        graph.done(order[-1])
    return order


def ranks(nodes: Sequence[N], edges: Iterable[tuple[N, N]], counts: Callable[[N, N], bool]) -> dict[N, int]:
    """Return the largest number of counted edges on a path to each node of an acyclic graph."""
    before: dict[N, list[N]] = {}
    for a, b in edges:
        before.setdefault(b, []).append(a)
    rank: dict[N, int] = {}
    for b in topological(nodes, edges):
        rank[b] = max((rank[a] + counts(a, b) for a in before.get(b, ())), default=0)
    return rank


def cycles(nodes: Sequence[N], edges: Iterable[tuple[N, N]]) -> list[tuple[list[N], list[N]]]:
    """Return the nodes of each strongly connected part with a cycle, and a shortest cycle that ends with its start."""
    edges = list(edges)
    index = {node: i for i, node in enumerate(nodes)}
    try:
        _sorter(nodes, edges).prepare()
        return []
    except CycleError:
        pass
    from scipy.sparse import coo_array  # takes 0.3 s to import, and most systems have no cycle
    from scipy.sparse.csgraph import connected_components

    rows, columns = (np.array([index[e[k]] for e in edges]) for k in (0, 1))
    graph = coo_array((np.ones(len(edges)), (rows, columns)), shape=(len(nodes), len(nodes)))
    _, labels = connected_components(graph, directed=True, connection="strong")
    parts: dict[int, list[N]] = {}
    for node, label in zip(nodes, labels, strict=True):
        parts.setdefault(int(label), []).append(node)
    after: dict[N, list[N]] = {}
    for a, b in edges:
        if labels[index[a]] == labels[index[b]]:
            after.setdefault(a, []).append(b)
    return [(part, _shortest(part[0], after)) for part in parts.values() if part[0] in after]


def _shortest(start: N, after: Mapping[N, Sequence[N]]) -> list[N]:
    """Return a shortest cycle through `start`, by breadth-first search."""
    before: dict[N, N] = {}
    queue = deque([start])
    while queue:
        node = queue.popleft()
        for following in sorted(after.get(node, ()), key=str):
            if following == start:
                path = [start]
                while node != start:
                    path.append(node)
                    node = before[node]
                return [*path, start][::-1]
            if following not in before:
                before[following] = node
                queue.append(following)
    raise AssertionError("every node of a strongly connected part lies on a cycle")
