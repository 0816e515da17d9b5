#pragma once

/// The files of host/report/assets.
namespace cleave::report::assets {

extern const char *const report_html, *const report_css, *const charts_js, *const viewer_js;

}  // namespace cleave::report::assets
