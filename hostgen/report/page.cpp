// index.html: results.json as tables and plots.
#include <nlohmann/json.hpp>
#include <sstream>

#include "hostgen/report/results.h"
#include "hostgen/util/common.h"

namespace finsight::host {

using nlohmann::json;

namespace {

constexpr const char* kHead = R"(<!doctype html>
<html lang="en"><head><meta charset="utf-8"><title>Finsight: speed and error</title>
<style>
body{font:15px/1.5 system-ui,sans-serif;max-width:60rem;margin:2rem auto;padding:0 1rem;color:#222}
h1,h2{font-weight:600}table{border-collapse:collapse;margin:.6rem 0}
th,td{padding:.2rem .8rem;border-bottom:1px solid #ddd;text-align:right;font-variant-numeric:tabular-nums}
th:first-child,td:first-child{text-align:left}.why{color:#777}img{max-width:100%}
</style></head><body>
<h1>Finsight: speed and error</h1>
)";

std::string escaped(const std::string& text) {
  std::string out;
  for (const char c : text) {
    switch (c) {
      case '&':
        out += "&amp;";
        break;
      case '<':
        out += "&lt;";
        break;
      case '>':
        out += "&gt;";
        break;
      default:
        out += c;
    }
  }
  return out;
}

std::string shown(const json& value) {
  if (value.is_null()) return "–";
  if (value.is_string()) return escaped(value.get<std::string>());
  if (value.is_number_float()) {
    std::ostringstream out;
    out.precision(4);
    out << value.get<double>();
    return out.str();
  }
  if (value.is_array()) {
    std::string text;
    for (const json& item : value) text += (text.empty() ? "" : " / ") + shown(item);
    return text;
  }
  if (value.is_object()) {
    std::string text;
    for (const auto& [key, item] : value.items()) text += (text.empty() ? "" : ", ") + escaped(key) + " " + shown(item);
    return text;
  }
  return escaped(value.dump());
}

// One row per figure; nested objects get dotted names; the reason for a null closes the table.
void add_rows(const json& object, const std::string& prefix, std::ostringstream& out) {
  for (const auto& [key, value] : object.items()) {
    if (key == "why") continue;
    if (value.is_array() && !value.empty() && value.front().is_object()) continue;  // a table of its own
    if (value.is_object()) {
      add_rows(value, prefix + key + ".", out);
    } else {
      out << "<tr><td>" << prefix << key << "</td><td>" << shown(value) << "</td></tr>\n";
    }
  }
  if (object.contains("why")) {
    out << "<tr><td class=why colspan=2>" << prefix << " not measured: " << shown(object["why"]) << "</td></tr>\n";
  }
}

void add_section(const json& results, const std::string& key, const std::string& title, std::ostringstream& out) {
  out << "<h2>" << title << "</h2>\n<table>\n";
  add_rows(results[key], "", out);
  out << "</table>\n";
}

void add_table(const json& rows, const std::vector<std::string>& columns, std::ostringstream& out) {
  if (!rows.is_array() || rows.empty()) return;
  out << "<table><tr>";
  for (const auto& column : columns) out << "<th>" << column << "</th>";
  out << "</tr>\n";
  for (const json& row : rows) {
    out << "<tr>";
    for (const auto& column : columns) out << "<td>" << shown(row.contains(column) ? row[column] : json()) << "</td>";
    out << "</tr>\n";
  }
  out << "</table>\n";
}

void add_speed_error(const json& rows, std::ostringstream& out) {
  out << "<h2>Speed against error</h2>\n<p>Distance of every node to the converged shape of the same frame; one "
         "core.</p>\n"
         "<img src=\"speed_error.svg\" alt=\"microseconds per frame against worst distance\">\n";
  add_table(
      rows,
      {"tier", "mesh_tets", "factorisations", "chords", "scalar", "motion", "us_per_frame", "worst_mm", "mean_mm"},
      out);
}

/// Each picture's figures with (`start` "zeroed") or without a zero.
json picture_rows(const json& pictures, const std::string& start) {
  json rows = json::array();
  for (const json& picture : pictures) {
    json row = picture[start].is_object() ? picture[start] : json::object();
    row["picture"] = picture["picture"];
    row["start"] = start;
    row["zero_frames"] = picture["zero_frames"];
    rows.push_back(row);
  }
  return rows;
}

}  // namespace

void write_index_html(const std::filesystem::path& folder, const Results& results) {
  const json& all = results.all();
  std::ostringstream out;
  out << kHead << "<p>" << shown(all["machine"]) << "; commit " << shown(all["commit"]) << "; profile "
      << shown(all["profile"]) << ". All figures: <a href=\"results.json\">results.json</a>.</p>\n<table>"
      << "<tr><th>area</th><th>measured</th><th>by</th></tr>\n";
  for (const auto& [area, how] : all["measured"].items()) {
    out << "<tr><td>" << area << "</td><td>" << shown(how["date"]) << "</td><td><code>" << shown(how["command"])
        << "</code></td></tr>\n";
  }
  out << "</table>\n";
  add_speed_error(all["speed_error"], out);
  add_section(all, "solver", "Solver", out);
  add_section(all, "mesh", "Mesh", out);
  add_section(all, "hard_cases", "Hard cases", out);
  add_section(all, "touch", "Touch", out);
  out << "<img src=\"touch_error.svg\" alt=\"touch error against plate motion\">\n<img src=\"touch_calibration.svg\" "
         "alt=\"share of errors inside the published radius\">\n";
  add_section(all, "shape", "Shape at the touched point", out);
  out << "<p>The firmware's tiers with this pack, on finite-element states of points that it was not trained on; "
         "contact_map_share: noisy frames that the contact-aware map answered (register 43).</p>\n";
  add_table(all["shape"].value("tiers", json()),
            {"tier", "touch_point_clean_mm", "touch_point_noisy_mm", "front_clean_mm", "front_noisy_mm", "us_per_frame",
             "contact_map_share"},
            out);
  add_section(all, "scene", "What a gripper brings", out);
  out << "<p>States that no training has seen, solved for each case and measured with the spec's noise by the whole "
         "firmware. contained: by the scene that the pack was trained for. lies: published and off by more than three "
         "radii, of all. Force: normal, across, along, where told (force_told: in which share); moment: x, y, z about "
         "the base.</p>\n";
  add_table(all["scene"].value("cases", json()),
            {"case", "contained", "trials", "published", "unexplained", "touch_mm", "touch_95_mm", "inside_radius",
             "inside_twice", "lies", "force_rmse_n", "force_told", "force_inside", "moment_rmse_nm", "moment_inside"},
            out);
  out << "<img src=\"scene_faces.svg\" alt=\"true and published touches over the face, by case\">\n<img "
         "src=\"scene_reliability.svg\" alt=\"share of errors inside the published radius, by case\">\n<p>The "
         "published "
         "deformation against the finite-element shape: mean and 95 % of the relative error, and the same of the "
         "largest "
         "displacement.</p>\n";
  add_table(all["scene"].value("shapes", json()),
            {"case", "tier", "level_bias", "level_95", "largest_bias_mm", "largest_95_mm", "us"}, out);
  out << "<p>What plate "
         "motions can tell at best (Fisher information at the spec's noise, contacts that move a plate by 4 mm or "
         "more, "
         "median standard deviation).</p>\n";
  add_table(all["scene"].value("floor", json()),
            {"unknown", "states", "x_mm", "y_mm", "normal_n", "across_n", "along_n", "radius_mm", "x_mm_2", "y_mm_2",
             "normal_n_2", "across_n_2", "along_n_2", "radius_mm_2"},
            out);
  add_section(all, "fem", "Finite-element truth", out);
  out << "<p>The same loads solved by CalculiX: largest distance between a node's two positions.</p>\n";
  add_table(all["fem"].value("calculix", json()),
            {"element", "tets", "load", "x_mm", "y_mm", "force_n", "largest_mm", "difference_mm"}, out);
  out << "<p>Locking: displacement of the touched point (0, 70) under 0.5 N.</p>\n";
  add_table(all["fem"].value("locking", json()), {"mesh", "tets", "C3D4_mm", "C3D10_mm", "C3D10_over_C3D4"}, out);
  add_section(all, "real", "Real recordings", out);
  out << "<img src=\"recordings.svg\" alt=\"contact points, rotations and motions of the recordings\">\n";
  add_section(all, "force", "Contact forces", out);
  out << "<p>From plate motions with the spec's noise. front_mm: mean distance of the front face's nodes from the "
         "truth. position_95_mm: how far away the least certain contact could be (95 %).</p>\n";
  add_table(all["force"].value("cases", json()),
            {"touch", "force_n", "contacts", "front_mm", "force_error_n", "position_95_mm", "truth_within_uncertainty",
             "gauss_newton_s", "lbfgs_s", "lbfgs_front_mm", "lbfgs_force_n"},
            out);
  out << "<img src=\"contact_forces.svg\" alt=\"objective against time, Gauss-Newton and L-BFGS\">\n";
  add_section(all, "pictures", "Pictures as cameras make them", out);
  for (const char* start : {"zeroed", "unzeroed", "mounted"}) {
    add_table(picture_rows(all.value("pictures", json::array()), start),
              {"picture", "start", "zero_frames", "firm_touches", "published", "touch_mm", "radius_mm", "coverage_68",
               "lies", "recall_top", "recall_middle", "recall_low"},
              out);
  }
  add_section(all, "vision", "Pixels to registers", out);
  for (const char* preset : {"lab", "factory", "worst"}) {
    out << "<p>Preset " << preset << ", by plate motion (the joint estimate, larger images).</p>\n";
    add_table(all["vision"][preset].value("by_plate_motion", json()),
              {"from_mm", "touches", "touch_mm", "touch_95_mm", "force_rmse_n", "level_rmse_permille", "coverage_68",
               "coverage_95"},
              out);
  }
  out << "<p>Methods from the same corners to plates; estimate_us: processor time of that step alone.</p>\n";
  add_table(all["vision"].value("methods", json()),
            {"preset", "method", "touch_mm_2_to_4", "touch_mm_above_4", "touch_mm_above_7", "false_valid",
             "flips_per_1000", "coverage_68", "coverage_95", "estimate_us_p50", "estimate_us_p99"},
            out);
  out << "<p>The paper's four paths in images of preset lab.</p>\n";
  add_table(all["vision"].value("paths", json()), {"path", "touches", "touch_mm", "touch_95_mm"}, out);
  out << "<img src=\"paths.svg\" alt=\"touched points found, over the true paths\">\n";
  out << "<p>Corners in rendered 1280x720 images, pixels: bias away from the marker's centre, RMS per coordinate. "
         "edges: the firmware's edge fit; sub_pix: OpenCV's cornerSubPix. All but the varied parameter as in preset "
         "lab.</p>\n";
  add_table(all["vision"].value("corners", json()),
            {"varied", "value", "corners", "markers_lost", "edges_bias_px", "edges_rms_px", "sub_pix_bias_px",
             "sub_pix_rms_px"},
            out);
  add_section(all, "modbus", "Modbus", out);
  add_section(all, "page", "The commissioning page", out);
  out << "<p>loop_cost_us: 99th percentile of a frame's time, from its arrival until everything is published, with "
         "browsers that watch at 1280x720 less that without, median over the rounds; allowed_us: the larger of 1 % and "
         "30 µs. The browsers run on the same machine.</p>\n";
  add_section(all, "appliance", "Appliance", out);
  out << "</body></html>\n";
  write_file_atomically(folder / "index.html", out.str());
}

}  // namespace finsight::host
