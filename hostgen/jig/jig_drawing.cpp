// One drawing at 1:1 on an A3 sheet: what is printed, how it hangs, and where its holes are.
#include <algorithm>
#include <cmath>
#include <functional>
#include <map>
#include <sstream>

#include "hostgen/finger/grid.h"
#include "hostgen/finger/surface.h"
#include "hostgen/finger/surface_finger.h"
#include "hostgen/jig/jig.h"
#include "hostgen/util/common.h"

namespace finsight::host {

namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;
using Edge = std::array<Vector3d, 2>;

constexpr double kSheetWidth_mm = 420, kSheetHeight_mm = 297;

/// Edges at which a surface bends by more than 20 degrees.
std::vector<Edge> feature_edges(const TriangleSurface& surface) {
  constexpr double kBend = 0.94;  // cosine
  std::map<std::pair<int, int>, std::vector<Vector3d>> normals;
  for (std::size_t t = 0; t < surface.triangle.size(); ++t) {
    const auto& [a, b, c] = surface.triangle[t];
    for (const auto& edge : {std::minmax(a, b), std::minmax(b, c), std::minmax(c, a)}) {
      normals[{edge.first, edge.second}].push_back(surface.twice_area(t).normalized());
    }
  }
  std::vector<Edge> edges;
  for (const auto& [edge, sides] : normals) {
    if (sides.size() == 2 && sides[0].dot(sides[1]) > kBend) continue;
    edges.push_back({surface.point_mm[static_cast<std::size_t>(edge.first)],
                     surface.point_mm[static_cast<std::size_t>(edge.second)]});
  }
  return edges;
}

/// The finger's, in the finger frame.
std::vector<Edge> finger_outline(const FingerSpec& spec) {
  if (spec.surface) return feature_edges(spec.surface->surface);
  return outline_edges(make_surface(make_grid(spec)));
}

class Sheet {
 public:
  Sheet() {
    out_.precision(2);
    out_ << std::fixed << "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"" << kSheetWidth_mm << "mm\" height=\""
         << kSheetHeight_mm << "mm\" viewBox=\"0 0 " << kSheetWidth_mm << ' ' << kSheetHeight_mm
         << "\" font-family=\"sans-serif\" font-size=\"4\">\n"
         << "<rect width=\"100%\" height=\"100%\" fill=\"#ffffff\"/>\n"
         << "<defs><marker id=\"tip\" viewBox=\"0 0 10 10\" refX=\"9\" refY=\"5\" markerWidth=\"5\" markerHeight=\"5\" "
            "orient=\"auto-start-reverse\"><path d=\"M0 0L10 5L0 10z\" fill=\"context-stroke\"/></marker></defs>\n";
  }
  void line(const Vector2d& from, const Vector2d& to, const std::string& colour, double width_mm,
            const std::string& more = "") {
    out_ << "<line x1=\"" << from.x() << "\" y1=\"" << from.y() << "\" x2=\"" << to.x() << "\" y2=\"" << to.y()
         << "\" stroke=\"" << colour << "\" stroke-width=\"" << width_mm << "\" stroke-linecap=\"round\" " << more
         << "/>\n";
  }
  void arrow(const Vector2d& from, const Vector2d& to, const std::string& colour) {
    line(from, to, colour, 0.6, "marker-end=\"url(#tip)\"");
  }
  void box(const Vector2d& corner, const Vector2d& size, const std::string& fill) {
    out_ << "<rect x=\"" << corner.x() << "\" y=\"" << corner.y() << "\" width=\"" << size.x() << "\" height=\""
         << size.y() << "\" fill=\"" << fill << "\" stroke=\"#333333\" stroke-width=\"0.3\"/>\n";
  }
  void text(const Vector2d& at, const std::string& words, double size_mm = 4, const std::string& anchor = "start") {
    out_ << "<text x=\"" << at.x() << "\" y=\"" << at.y() << "\" font-size=\"" << size_mm << "\" text-anchor=\""
         << anchor << "\">";
    for (const char c : words) out_ << (c == '&' ? "&amp;" : c == '<' ? "&lt;" : std::string(1, c));
    out_ << "</text>\n";
  }
  std::string finished() const { return out_.str() + "</svg>\n"; }

 private:
  std::ostringstream out_;
};

std::string number_text(double value, int digits = 1) {
  std::ostringstream text;
  text.precision(digits);
  text << std::fixed << value;
  return text.str();
}

/// Places points of the jig's frame on the sheet: `flat` turns them, then their lowest corner comes to `corner_mm`.
struct View {
  std::function<Vector2d(const Vector3d&)> flat;
  Vector2d shift = Vector2d::Zero();
  Vector2d low = Vector2d::Constant(1e9), high = Vector2d::Constant(-1e9);

  void hold(const std::vector<Edge>& edges) {
    for (const Edge& edge : edges) {
      for (const Vector3d& end : edge) {
        low = low.cwiseMin(flat(end));
        high = high.cwiseMax(flat(end));
      }
    }
  }
  void place(const Vector2d& corner_mm) { shift = corner_mm - low; }
  Vector2d operator()(const Vector3d& at) const { return flat(at) + shift; }
};

void draw(Sheet& sheet, const View& view, const std::vector<Edge>& edges, const std::string& colour, double width_mm) {
  for (const Edge& edge : edges) sheet.line(view(edge[0]), view(edge[1]), colour, width_mm);
}

/// The slab's outer face, as it looks at whoever puts the weights on.
void draw_front(Sheet& sheet, const Jig& jig, const std::vector<Edge>& edges) {
  std::vector<Edge> outer;
  for (const Edge& edge : edges) {
    if (edge[0].z() < jig.fit.print_bed_z_mm + 1e-6 && edge[1].z() < jig.fit.print_bed_z_mm + 1e-6)
      outer.push_back(edge);
  }
  View view{.flat = [](const Vector3d& at) { return Vector2d(-at.x(), -at.y()); }};
  view.hold(outer);
  view.place({20, 40});
  sheet.text({20, 34}, "Outer face, seen from outside (1:1)", 5);
  draw(sheet, view, outer, "#222222", 0.3);
  for (const JigHole& hole : jig.fit.holes) {
    const Vector2d at = view(jig.fit.T_finger_jig.inverse() * hole.contact_mm);
    sheet.line(at - Vector2d(3, 0), at + Vector2d(3, 0), "#888888", 0.15);
    sheet.line(at - Vector2d(0, 3), at + Vector2d(0, 3), "#888888", 0.15);
    sheet.text(at + Vector2d(3, -2.2), std::to_string(hole.number), 4.5);
  }
  const Vector2d low = view.low + view.shift, high = view.high + view.shift;
  const double y_mm = high.y() + 7;
  sheet.arrow({0.5 * (low.x() + high.x()), y_mm}, {low.x(), y_mm}, "#555555");
  sheet.arrow({0.5 * (low.x() + high.x()), y_mm}, {high.x(), y_mm}, "#555555");
  sheet.text({0.5 * (low.x() + high.x()), y_mm + 5}, number_text(high.x() - low.x()) + " mm", 4, "middle");
  sheet.text({0.5 * (low.x() + high.x()), y_mm + 11}, "base (flush with what the finger is mounted on)", 3.5, "middle");
}

/// From the side, hung so that the guides are upright.
void draw_hanging(Sheet& sheet, const Jig& jig, const std::vector<Edge>& edges, std::vector<Edge> finger) {
  const Eigen::Isometry3d T_jig_finger = jig.fit.T_finger_jig.inverse();
  for (Edge& edge : finger) edge = {T_jig_finger * edge[0], T_jig_finger * edge[1]};
  View view{.flat = [](const Vector3d& at) { return Vector2d(at.y(), at.z()); }};
  view.hold(edges);
  view.hold(finger);
  view.place({190, 78});
  sheet.text({180, 34}, "How it hangs: guides upright, weights on the pin", 5);
  draw(sheet, view, finger, "#b9a27a", 0.2);
  draw(sheet, view, edges, "#222222", 0.3);

  const JigHole& middle = jig.fit.holes[jig.fit.holes.size() / 2];
  const Vector3d contact = T_jig_finger * middle.contact_mm;
  const Vector2d tip = view(contact), head = view({0, contact.y(), jig.fit.print_bed_z_mm}) - Vector2d(0, 14);
  sheet.line(head, tip, "#1f5fa8", kJigPinMm, "stroke-opacity=\"0.55\" style=\"stroke-linecap:butt\"");
  sheet.box(head - Vector2d(14, 12), {28, 12}, "#d8dde3");
  sheet.text(head - Vector2d(0, 4.5), "weight m", 4, "middle");
  sheet.text(head + Vector2d(5, 8), "pin of " + number_text(kJigPinMm, 0) + " mm, rounded end, slides freely", 3.5);
  const Vector2d g = view({0, contact.y(), jig.fit.print_bed_z_mm}) + Vector2d(70, -10);
  sheet.arrow(g, g + Vector2d(0, 22), "#b02a2a");
  sheet.text(g + Vector2d(3, 12), "gravity", 4);
  sheet.text(g + Vector2d(3, 17), "F = (m + pin) g", 4);

  // The mount is where the finger's base plane is.
  const Vector3d base(0, jig.fit.base_y_mm, 0);
  const double from = view.low.y() + view.shift.y() - 2, to = view.high.y() + view.shift.y() + 4;
  const Eigen::Matrix3d R = jig.fit.T_finger_jig.linear();
  const auto at_height = [&](double paper_y) {
    const double z = paper_y - view.shift.y();
    return Vector2d((base.y() - R(1, 2) * z) / R(1, 1) + view.shift.x(), paper_y);
  };
  sheet.line(at_height(from), at_height(to), "#333333", 0.8);
  for (double y = from; y < to; y += 5) {
    sheet.line(at_height(y), at_height(y) + Vector2d(-5, 4), "#333333", 0.25);
  }
  sheet.text(at_height(to) + Vector2d(-6, 8), "mount with the camera, held so that a level on the slab shows level",
             3.5);
}

void write_table(Sheet& sheet, const FingerSpec& spec, const Jig& jig) {
  Vector2d at(20, 205);
  sheet.text(at, "Where the pin's end meets the undeformed face (finger frame, mm)", 4.5);
  constexpr double kColumn_mm = 22, kRow_mm = 6;
  at += Vector2d(0, kRow_mm + 1);
  const char* const heads[] = {"hole", "x", "y", "z"};
  for (int c = 0; c < 4; ++c) sheet.text(at + Vector2d(kColumn_mm * c + 10, 0), heads[c], 4, "end");
  for (const JigHole& hole : jig.fit.holes) {
    at.y() += kRow_mm;
    sheet.text(at + Vector2d(10, 0), std::to_string(hole.number), 4, "end");
    for (int c = 0; c < 3; ++c) {
      sheet.text(at + Vector2d(kColumn_mm * (c + 1) + 10, 0), number_text(hole.contact_mm[c], 2), 4, "end");
    }
  }
  const Vector3d inward = jig.fit.holes.front().inward;
  const std::vector<std::string> words = {
      "Finger " + spec.name + ", spec " + spec.sha256.substr(0, 12),
      "The pin presses along (" + number_text(inward.x(), 4) + ", " + number_text(inward.y(), 4) + ", " +
          number_text(inward.z(), 4) + ") of the finger frame.",
      "Bores of " + number_text(kJigBoreMm) + " mm: drill them out to " + number_text(kJigBoreMm) +
          " mm if the pin does not fall through.",
      "Print with the numbered face on the bed, 100 % size, without supports, in PETG or PLA.",
      "Snap the cheeks around the base, the slab's end flush with the mount. Nothing but the pin",
      "may touch the face. Zero the finger once, rested, with the jig on and the pin out; not between weights.",
      "The pin's own mass and that of its tray are part of every weight.",
      "1 kg presses with 9.81 N, 100 g with 0.98 N."};
  Vector2d line(190, 205);
  for (const std::string& sentence : words) {
    sheet.text(line, sentence, 4.2);
    line.y() += 7;
  }
}

}  // namespace

void draw_jig(const std::filesystem::path& svg, const FingerSpec& spec, const Jig& jig) {
  TriangleSurface in_jig_frame = jig.surface;
  for (Vector3d& point : in_jig_frame.point_mm) point.z() += jig.fit.print_bed_z_mm;
  const std::vector<Edge> edges = feature_edges(in_jig_frame);
  Sheet sheet;
  sheet.text({20, 20}, "Jig for known weights: finger " + spec.name, 8);
  draw_front(sheet, jig, edges);
  draw_hanging(sheet, jig, edges, finger_outline(spec));
  write_table(sheet, spec, jig);
  write_file_atomically(svg, sheet.finished());
}

}  // namespace finsight::host
