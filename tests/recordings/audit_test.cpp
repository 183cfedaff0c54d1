#include "hostgen/recordings/audit.h"

#include <doctest/doctest.h>
#include <unistd.h>

#include <cmath>
#include <fstream>

#include "tests/recordings/synthetic_recordings.h"

using namespace finsight;
using namespace finsight::host;

namespace {

std::string line_of(const std::string& table, const std::string& question) {
  const std::size_t at = table.find(question);
  return at == std::string::npos ? "" : table.substr(at, table.find('\n', at) - at);
}

}  // namespace

TEST_CASE("audit: good recordings pass, except for the markers that they lack") {
  const RecordingAudit audit = audit_recordings(test::synthetic_recordings({}));
  CHECK(audit.rows == 16 * 90);
  CHECK(audit.recordings == 16);
  CHECK(audit.contact_points == 16);
  CHECK(audit.pushes_per_recording == doctest::Approx(3).epsilon(0.05));
  CHECK(audit.recorded == std::array<bool, kPlates>{true, false, false});
  CHECK(audit.repeated == 0);
  CHECK(audit.leaked == 0);
  CHECK(audit.outliers.empty());
  CHECK(audit.pen_residual_mm[0] == doctest::Approx(0.2).epsilon(0.1));
  CHECK(audit.jitter_in_pen < 0.9);
  CHECK(audit.slope == doctest::Approx(0.222).epsilon(0.05));
  CHECK(audit.y_mm[0] == doctest::Approx(15).epsilon(0.05));
  const std::string table = audit_table(audit);
  CAPTURE(table);
  for (const char* question : {"repeated rows", "random split", "rotation", "outliers", "direction", "truth"}) {
    CHECK(line_of(table, question).ends_with("ok"));
  }
  CHECK(line_of(table, "markers").find("PROBLEM") != std::string::npos);
}

TEST_CASE("audit: finds each fault and reports it as a problem") {
  const auto audited = [](const test::RecordingFaults& faults) {
    return audit_recordings(test::synthetic_recordings(faults));
  };
  const auto problem = [](const RecordingAudit& audit, const char* question) {
    return line_of(audit_table(audit), question).find("PROBLEM") != std::string::npos;
  };
  const RecordingAudit repeated = audited({.repeats = 2});
  CHECK(repeated.repeated == doctest::Approx(0.5));
  CHECK(repeated.leaked ==
        doctest::Approx(0.7).epsilon(0.08));  // a test row's copy is in the training set with probability 0.7
  CHECK(problem(repeated, "repeated rows"));
  CHECK(problem(repeated, "random split"));

  const RecordingAudit flips = audited({.rotation_noise_rad = 0.03});
  CHECK(flips.change_deg[0] > 1.5);
  CHECK(problem(flips, "rotation"));

  const RecordingAudit outlier = audited({.outlier = true});
  REQUIRE(outlier.outliers.size() == 1);
  CHECK(outlier.outliers[0].line == 27);
  CHECK(outlier.outliers[0].motion_mm == doctest::Approx(80));
  CHECK(outlier.largest_motion_mm < 60);
  CHECK(problem(outlier, "outliers"));

  const RecordingAudit computed = audited({.rotation_noise_rad = 0.01, .pen_noise_mm = 0});
  CHECK(computed.pen_residual_mm[2] < 0.001);
  CHECK(computed.jitter_in_pen > 0.99);
  CHECK(problem(computed, "truth"));
}

TEST_CASE("audit: the image is an SVG") {
  const std::filesystem::path svg =
      std::filesystem::temp_directory_path() / ("finsight_audit_" + std::to_string(getpid()) + ".svg");
  const RecordedMotion motion = test::synthetic_recordings({}, 1);
  plot_audit(audit_recordings(motion), motion, svg);
  std::ifstream in(svg);
  const std::string text{std::istreambuf_iterator<char>(in), {}};
  CHECK(text.find("<svg") != std::string::npos);
  CHECK(text.find("Contact points") != std::string::npos);
  std::filesystem::remove(svg);
}
