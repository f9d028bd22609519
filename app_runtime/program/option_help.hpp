// Help text in 80 columns; CLI11 of Debian's version does not wrap.
#pragma once

#include <CLI/CLI.hpp>
#include <sstream>
#include <string>

namespace sim2vr::program {

class OptionHelp : public CLI::Formatter {
 public:
  std::string make_option(const CLI::Option* option, bool is_positional) const override {
    const std::string name =
        "  " + make_option_name(option, is_positional) + make_option_opts(option);
    std::ostringstream out;
    out << name;
    std::size_t column = name.size();
    if (column + 1 > kHelpColumn) {
      out << '\n';
      column = 0;
    }
    std::istringstream words(make_option_desc(option));
    std::string word;
    bool is_first = true;
    while (words >> word) {
      if (!is_first && column + 1 + word.size() > kColumns) {
        out << '\n';
        column = 0;
        is_first = true;
      }
      if (is_first) {
        out << std::string(kHelpColumn - column, ' ');
        column = kHelpColumn;
      } else {
        out << ' ';
        ++column;
      }
      out << word;
      column += word.size();
      is_first = false;
    }
    out << '\n';
    return out.str();
  }

 private:
  static constexpr std::size_t kColumns = 80;
  static constexpr std::size_t kHelpColumn = 28;
};

}  // namespace sim2vr::program
