// The certificate of a verification, as JSON and as a page.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <nlohmann/json.hpp>
#include <sstream>

#include "firmware/settings/measured_fit.h"
#include "hostgen/fit/verification.h"

namespace finsight::host {

using nlohmann::json;

namespace {

std::string number(double value, int digits = 2) {
  char text[32];
  std::snprintf(text, sizeof text, "%.*f", digits, value);
  return text;
}

std::string escaped(const std::string& text) {
  std::string safe;
  for (const char c : text) {
    if (c == '<')
      safe += "&lt;";
    else if (c == '>')
      safe += "&gt;";
    else if (c == '&')
      safe += "&amp;";
    else if (c == '"')
      safe += "&quot;";
    else
      safe += c;
  }
  return safe;
}

std::string date_text(std::uint32_t date) {
  char text[16];
  std::snprintf(text, sizeof text, "%04u-%02u-%02u", date / 10000, date / 100 % 100, date % 100);
  return text;
}

json optional_json(const std::optional<double>& value) { return value ? json(*value) : json(); }

/// Found against hung up, with the stated deviations.
std::string force_plot(const Verification& verification) {
  constexpr double kSide = 320, kMargin = 40;
  double most_n = 1;
  for (const Plateau& plateau : verification.plateaus) most_n = std::max({most_n, plateau.force_n, plateau.found_n});
  most_n *= 1.1;
  const auto at = [&](double n) { return kMargin + (kSide - kMargin) * n / most_n; };
  std::ostringstream svg;
  svg << "<svg viewBox='0 0 " << kSide + 10 << ' ' << kSide + 30
      << "' role='img' aria-label='Force found against force hung up'>"
      << "<g transform='translate(0," << kSide << ") scale(1,-1)'><path class='axis' d='M" << kMargin << ' ' << kSide
      << 'V' << kMargin << 'H' << kSide << "'/><path class='aim' d='M" << kMargin << ' ' << kMargin << 'L' << kSide
      << ' ' << kSide << "'/>";
  for (const Plateau& plateau : verification.plateaus) {
    svg << "<path class='bar' d='M" << number(at(plateau.force_n)) << ' '
        << number(at(std::max(0.0, plateau.found_n - plateau.sigma_n))) << 'V'
        << number(at(plateau.found_n + plateau.sigma_n)) << "'/><circle class='" << (plateau.is_down ? "down" : "up")
        << "' cx='" << number(at(plateau.force_n)) << "' cy='" << number(at(plateau.found_n)) << "' r='3'/>";
  }
  svg << "</g>";
  for (int n = 1; n < most_n; ++n) {
    svg << "<text x='" << number(at(n)) << "' y='" << kSide - kMargin + 16 << "' text-anchor='middle'>" << n
        << "</text><text x='" << kMargin - 6 << "' y='" << number(kSide - at(n) + 4) << "' text-anchor='end'>" << n
        << "</text>";
  }
  svg << "<text x='" << kSide << "' y='" << kSide - 8
      << "' text-anchor='end'>force hung up, N</text><text x='4' y='12'>found, N</text></svg>";
  return svg.str();
}

/// The face as the camera of the gripper faces it: where weights hung and where the finger says they did.
std::string face_plot(const Verification& verification, double magnified) {
  float left = 0, right = 0, low = 1e9F, high = -1e9F;
  for (const Plateau& plateau : verification.plateaus) {
    left = std::min(left, plateau.truth_mm.x());
    right = std::max(right, plateau.truth_mm.x());
    low = std::min(low, plateau.truth_mm.y());
    high = std::max(high, plateau.truth_mm.y());
  }
  const auto width = static_cast<double>(right - left) + 30, height = static_cast<double>(high - low) + 30;
  const auto x = [&](double mm) { return number(mm - static_cast<double>(left) + 15); };
  const auto y = [&](double mm) { return number(static_cast<double>(high) - mm + 15); };
  std::ostringstream svg;
  svg << "<svg viewBox='0 0 " << number(width) << ' ' << number(height)
      << "' role='img' aria-label='Touch errors over the face'>"
      << "<rect class='face' x='4' y='4' width='" << number(width - 8) << "' height='" << number(height - 8)
      << "' rx='4'/>";
  for (const Plateau& plateau : verification.plateaus) {
    const double tx = static_cast<double>(plateau.truth_mm.x()), ty = static_cast<double>(plateau.truth_mm.y());
    const double dx = magnified * (static_cast<double>(plateau.found_mm.x()) - tx),
                 dy = magnified * (static_cast<double>(plateau.found_mm.y()) - ty);
    svg << "<circle class='radius' cx='" << x(tx) << "' cy='" << y(ty) << "' r='"
        << number(magnified * plateau.radius_mm) << "'/><path class='error' d='M" << x(tx) << ' ' << y(ty) << 'L'
        << x(tx + dx) << ' ' << y(ty + dy) << "'/><circle class='up' cx='" << x(tx + dx) << "' cy='" << y(ty + dy)
        << "' r='0.9'/>";
  }
  for (const Plateau& plateau : verification.plateaus) {
    svg << "<text class='hole' x='" << x(static_cast<double>(plateau.truth_mm.x()) - 4) << "' y='"
        << y(static_cast<double>(plateau.truth_mm.y()) - 1) << "'>" << plateau.hole << "</text>";
  }
  svg << "</svg>";
  return svg.str();
}

constexpr const char* kStyle =
    "body{font:15px/1.5 system-ui,sans-serif;max-width:60rem;margin:2rem auto;padding:0 "
    "1rem;color:#1c2733;background:#fff}"
    "h1{font-size:1.5rem}table{border-collapse:collapse;margin:1rem 0;width:100%}"
    "td,th{border-bottom:1px solid #ccd3da;padding:.25rem .6rem;text-align:left}td.n{text-align:right;"
    "font-variant-numeric:tabular-nums}.verdict{font-size:1.3rem;font-weight:600;padding:.4rem "
    "1rem;display:inline-block;"
    "border-radius:.3rem;color:#fff}.passed{background:#1a7f45}.failed{background:#b3261e}tr.bad "
    "td{color:#b3261e;font-weight:600}"
    ".plots{display:flex;gap:2rem;flex-wrap:wrap}.plots figure{flex:1 1 18rem;margin:0;max-width:26rem}"
    "svg{width:100%;max-height:26rem;font-size:11px}svg .hole{font-size:4px}"
    ".axis{fill:none;stroke:#445}.aim{stroke:#99a;stroke-dasharray:4}.bar,.error{stroke:#2358a6;stroke-width:1}"
    ".error{stroke-width:.5}.up{fill:#2358a6}.down{fill:#c7651a}.face{fill:#eef2f6;stroke:#99a;stroke-width:.5}.radius{"
    "fill:none;"
    "stroke:#99a;"
    "stroke-width:.3}code{white-space:pre-wrap}@media(prefers-color-scheme:dark){body{color:#e4e9ee;background:#12181e}"
    "td,th{border-color:#394450}.face{fill:#1f2933}svg text{fill:#e4e9ee}.axis{stroke:#aab}}"
    "@media print{body{margin:0;color:#000;background:#fff}}";

std::string limit_text(const Check& check) {
  return check.limit ? std::string(check.at_least ? "at least " : "at most ") + number(*check.limit) : "";
}

/// As far as the register goes.
double hundredths(double value) { return std::round(100 * std::min(value, 655.0)) / 100; }

/// Of the device, as its page and finsightctl take them. A daily check renews no verification, but may end one.
json settings_of(const Verification& verification, const CertificateHead& head) {
  if (head.is_quick) return verification.passed ? json::object() : json{{"verdict", "failed"}};
  return {{"verified_on", days_of(head.date)},
          {"verdict", verification.passed ? "passed" : "failed"},
          {"force_expanded_uncertainty", hundredths(verification.force_expanded_n)},
          {"touch_expanded_uncertainty", hundredths(verification.touch_expanded_mm)}};
}

}  // namespace

json verification_json(const VerificationPlan& plan, const Verification& verification, const CertificateHead& head) {
  json checks = json::array(), plateaus = json::array(), budget = json::array(), missed = json::array();
  for (const MissedWeight& weight : verification.missed) {
    missed.push_back({{"session", weight.session}, {"hole", weight.hole}, {"force_n", weight.force_n}});
  }
  for (const Check& check : verification.checks) {
    checks.push_back({{"name", check.name},
                      {"clause", check.clause},
                      {"unit", check.unit},
                      {"value", optional_json(check.value)},
                      {"limit", optional_json(check.limit)},
                      {"passed", check.passes()}});
  }
  for (const Plateau& plateau : verification.plateaus) {
    plateaus.push_back({{"session", plateau.session},
                        {"hole", plateau.hole},
                        {"force_n", plateau.force_n},
                        {"down", plateau.is_down},
                        {"lasted_s", plateau.lasted_s},
                        {"found_n", plateau.found_n},
                        {"sigma_n", plateau.sigma_n},
                        {"found_mm", {plateau.found_mm.x(), plateau.found_mm.y(), plateau.found_mm.z()}},
                        {"truth_mm", {plateau.truth_mm.x(), plateau.truth_mm.y(), plateau.truth_mm.z()}},
                        {"radius_mm", plateau.radius_mm}});
  }
  for (const BudgetLine& line : verification.budget) {
    budget.push_back(
        {{"source", line.source}, {"how", line.how}, {"force_n", line.force_n}, {"touch_mm", line.touch_mm}});
  }
  return {{"finger", plan.finger},
          {"date", date_text(head.date)},
          {"quick", head.is_quick},
          {"pack", head.pack},
          {"fit", head.fit},
          {"mount", head.mount},
          {"passed", verification.passed},
          {"force_expanded_n", verification.force_expanded_n},
          {"touch_expanded_mm", verification.touch_expanded_mm},
          {"settings", settings_of(verification, head)},
          {"checks", checks},
          {"budget", budget},
          {"weights", plateaus},
          {"not_detected", missed}};
}

std::string certificate_html(const VerificationPlan& plan, const Verification& verification,
                             const CertificateHead& head, const std::string& commands) {
  std::ostringstream page;
  page << "<!doctype html><html lang='en'><meta charset='utf-8'><meta name='viewport' content='width=device-width'>"
       << "<title>Certificate " << escaped(plan.finger) << "</title><style>" << kStyle << "</style><h1>"
       << (head.is_quick ? "Quick check" : "Verification") << " of finger " << escaped(plan.finger) << "</h1><p>"
       << date_text(head.date) << " &middot; pack " << escaped(head.pack) << " &middot; fit " << escaped(head.fit)
       << " &middot; mount " << escaped(head.mount) << " &middot; "
       << verification.plateaus.size() + verification.missed.size() << " weights in " << plan.series.size()
       << (plan.series.size() == 1 ? " recording</p>" : " recordings</p>")
       << (head.is_quick ? "<p>Judged by what these recordings tell; it renews no verification.</p>" : "")
       << "<p class='verdict " << (verification.passed ? "passed'>Passed" : "failed'>Failed")
       << "</p><table><tr><th>What<th>Clause<th>Found<th>Limit<th></tr>";
  for (const Check& check : verification.checks) {
    page << "<tr" << (check.passes() ? "" : " class='bad'") << "><td>" << check.name << "<td>" << check.clause
         << "<td class='n'>"
         << (check.value ? number(*check.value) + " " + check.unit : std::string("not told by these recordings"))
         << "<td>" << limit_text(check) << "<td>"
         << (!check.limit     ? ""
             : check.passes() ? "passed"
                              : "failed")
         << "</tr>";
  }
  page << "</table><div class='plots'><figure>" << force_plot(verification)
       << "<figcaption>Blue: weights going up, orange: down; bars: the stated standard "
          "deviation.</figcaption></figure><figure>"
       << face_plot(verification, 3)
       << "<figcaption>From the hole to where the finger says it was touched, three times as long as it is; circles: "
          "the "
          "stated radius, "
          "likewise.</figcaption></figure></div><h2>Uncertainty</h2><table><tr><th>Source<th>From<th>Force, "
          "N<th>Touch, mm</tr>";
  for (const BudgetLine& line : verification.budget) {
    page << "<tr><td>" << line.source << "<td>" << line.how << "<td class='n'>" << number(line.force_n, 3)
         << "<td class='n'>" << number(line.touch_mm, 3) << "</tr>";
  }
  page << "<tr><th>Expanded, k = 2<td>root of the sum of squares, twice<td class='n'>"
       << number(verification.force_expanded_n, 3) << "<td class='n'>" << number(verification.touch_expanded_mm, 3)
       << "</tr></table><h2>Weights</h2><table><tr><th>Recording"
       << "<th>Hole<th>Hung up, N<th>Found, N<th>Deviation, N<th>Touch off, mm<th>Radius, mm</tr>";
  for (const Plateau& plateau : verification.plateaus) {
    page << "<tr><td>" << escaped(plateau.session) << (plateau.is_down ? " (down)" : "") << "<td class='n'>"
         << plateau.hole << "<td class='n'>" << number(plateau.force_n) << "<td class='n'>" << number(plateau.found_n)
         << "<td class='n'>" << number(plateau.sigma_n) << "<td class='n'>"
         << number(static_cast<double>((plateau.found_mm - plateau.truth_mm).norm())) << "<td class='n'>"
         << number(plateau.radius_mm) << "</tr>";
  }
  for (const MissedWeight& weight : verification.missed) {
    page << "<tr class='bad'><td>" << escaped(weight.session) << "<td class='n'>" << weight.hole << "<td class='n'>"
         << number(weight.force_n) << "<td colspan='4'>not detected</tr>";
  }
  page << "</table>";
  if (!commands.empty()) {
    page << "<h2>Into the device</h2><p>These commands write the verdict into the device's registers:</p><code>"
         << escaped(commands) << "</code>";
  }
  page << "</html>\n";
  return page.str();
}

}  // namespace finsight::host
