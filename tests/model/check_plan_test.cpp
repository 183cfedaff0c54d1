// Plans of the factorisation that would make the solver read beyond its memory or factor a wrong matrix.
#include <doctest/doctest.h>

#include <limits>
#include <numeric>

#include "firmware/model/checks.h"
#include "tests/model/hostile_pack.h"

using namespace finsight;
using namespace finsight::test;

namespace {

/// One supernode over all columns: the dense factorisation.
void make_dense(TinyModel& tiny) {
  tiny.supernode_start = {0, static_cast<std::int32_t>(tiny.order.size())};
  tiny.rows_start = {0, 0};
  tiny.rows.clear();
}

/// The first supernode with at least `count` rows below its columns.
std::size_t supernode_with(const TinyModel& tiny, std::int32_t count) {
  std::size_t s = 0;
  while (tiny.rows_start[s + 1] - tiny.rows_start[s] < count) ++s;
  return s;
}

void remove_row(TinyModel& tiny, std::size_t supernode, std::ptrdiff_t row) {
  tiny.rows.erase(tiny.rows.begin() + tiny.rows_start[supernode] + row);
  for (std::size_t s = supernode + 1; s < tiny.rows_start.size(); ++s) --tiny.rows_start[s];
}

}  // namespace

TEST_CASE("plan: one column per supernode and one supernode over all are both accepted") {
  const ScratchFolder folder;
  TinyModel tiny;
  CHECK_NOTHROW(tiny.write(folder / "pack"));
  make_dense(tiny);
  CHECK_NOTHROW(tiny.write(folder / "pack"));
}

TEST_CASE("plan: refuses an order that is not a permutation") {
  const HostileModel all[] = {
      {"twice", [](TinyModel& t) { t.order[3] = t.order[4]; }, "'cholesky.order': found 22 at position 4"},
      {"too large", [](TinyModel& t) { t.order[0] = 27; }, "found 27 at position 0, expected each of 0 to 26 once"},
      {"negative", [](TinyModel& t) { t.order[26] = -1; }, "found -1 at position 26"},
  };
  check_refused(all);
}

TEST_CASE("plan: refuses a pattern that is not exactly the couplings of the tets") {
  const HostileModel all[] = {
      {"another order", [](TinyModel& t) { std::swap(t.order[0], t.order[26]); }, "as the tets couple the nodes"},
      {"row too many",
       [](TinyModel& t) {
         t.pattern_row.push_back(0);
         ++t.pattern_start.back();
       },
       "found row 0 in column 26, expected no further block"},
      {"last row missing",
       [](TinyModel& t) {
         t.pattern_row.pop_back();
         --t.pattern_start.back();
       },
       "ascending indices"},
      {"row out of range", [](TinyModel& t) { t.pattern_row[1] = 27; }, "found row 27 in column 0"},
      {"row negative", [](TinyModel& t) { t.pattern_row[1] = -5; }, "found row -5 in column 0"},
      {"diagonal not first", [](TinyModel& t) { std::swap(t.pattern_row[0], t.pattern_row[1]); },
       "expected row 0 in column 0"},
      {"column starts elsewhere", [](TinyModel& t) { ++t.pattern_start[1]; }, "'cholesky.pattern_row'"},
      {"start not 0", [](TinyModel& t) { t.pattern_start[0] = 1; }, "'cholesky.pattern_start': found 1 to "},
      {"start negative", [](TinyModel& t) { t.pattern_start[0] = -1; }, "'cholesky.pattern_start': found -1 to "},
      {"end beyond", [](TinyModel& t) { t.pattern_start[27] = 1000000; },
       "'cholesky.pattern_start': found 0 to 1000000"},
      {"descending", [](TinyModel& t) { std::swap(t.pattern_start[3], t.pattern_start[4]); }, "ascending indices"},
      {"extremes",
       [](TinyModel& t) {
         t.pattern_start[3] = std::numeric_limits<std::int32_t>::min();
         t.pattern_start[4] = std::numeric_limits<std::int32_t>::max();
       },
       "ascending indices"},
  };
  check_refused(all);
}

TEST_CASE("plan: refuses supernodes that do not divide the columns") {
  const HostileModel all[] = {
      {"empty one", [](TinyModel& t) { t.supernode_start[5] = t.supernode_start[4]; },
       "'cholesky.supernode_start': found 4 before 4"},
      {"beyond", [](TinyModel& t) { t.supernode_start[27] = 28; }, "found 0 to 28, expected 0 to 27"},
      {"not from 0",
       [](TinyModel& t) {
         make_dense(t);
         t.supernode_start[0] = 1;
       },
       "found 1 to 27, expected 0 to 27"},
  };
  check_refused(all);
}

TEST_CASE("plan: refuses rows out of order, out of range or not below their supernode") {
  const HostileModel all[] = {
      {"starts descend",
       [](TinyModel& t) {
         t.rows_start[2] = 0;
         t.rows_start[1] = 1;
       },
       "'cholesky.rows_start': found 1 before 0"},
      {"starts beyond", [](TinyModel& t) { t.rows_start.back() += 5; }, "'cholesky.rows_start': found 0 to "},
      {"order", [](TinyModel& t) { std::swap(t.rows[0], t.rows[1]); },
       "'cholesky.rows': found rows out of order or range at supernode 0"},
      {"twice", [](TinyModel& t) { t.rows[1] = t.rows[0]; }, "rows out of order"},
      {"own column", [](TinyModel& t) { t.rows[0] = 0; }, "expected ascending positions from 1 to 26"},
      {"too large", [](TinyModel& t) { t.rows[static_cast<std::size_t>(t.rows_start[1]) - 1] = 27; },
       "rows out of order or range"},
  };
  check_refused(all);
}

TEST_CASE("plan: refuses rows that lack a place for what a column couples or an elimination fills in") {
  const HostileModel all[] = {
      {"coupled", [](TinyModel& t) { remove_row(t, 0, 0); }, "'cholesky.rows': found rows missing at supernode 0"},
      {"filled in",
       [](TinyModel& t) {
         // The last row of a later column that exists only as fill-in of another.
         for (std::size_t s = supernode_with(t, 2);; ++s) {
           const auto first = t.pattern_row.begin() + t.pattern_start[s],
                      last = t.pattern_row.begin() + t.pattern_start[s + 1];
           for (std::int32_t r = t.rows_start[s]; r < t.rows_start[s + 1]; ++r) {
             if (std::find(first, last, t.rows[static_cast<std::size_t>(r)]) != last) continue;
             remove_row(t, s, r - t.rows_start[s]);
             return;
           }
         }
       },
       "'cholesky.rows': found rows missing at supernode"},
  };
  check_refused(all);
}

TEST_CASE("plan: refuses a factor too large for any board's memory") {
  // 3000 uncoupled nodes, yet eliminated as one dense block.
  constexpr std::int32_t kBlocks = 3000;
  std::vector<std::int32_t> nodes(kBlocks), starts(kBlocks + 1), tets;
  std::iota(nodes.begin(), nodes.end(), 0);
  std::iota(starts.begin(), starts.end(), 0);
  for (const std::int32_t node : nodes) tets.insert(tets.end(), 4, node);
  const std::vector<std::int32_t> one_supernode = {0, kBlocks}, no_rows = {0, 0};
  ShapeModel shape;
  shape.nodes = shape.tets = kBlocks;
  shape.tet_nodes = tets;
  shape.free_index = nodes;
  shape.cholesky = {kBlocks, nodes, starts, nodes, one_supernode, no_rows, {}};

  const ScratchFolder folder;
  TinyModel().write(folder / "pack");
  const SafetensorsFile file = SafetensorsFile::open(folder / "pack");
  CHECK_THROWS_WITH_AS(check_plan(file, shape), doctest::Contains("a factor of over 67108864 numbers"), InputError);
}
