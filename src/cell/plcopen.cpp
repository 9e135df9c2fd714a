// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The program for the PLC as PLCopen XML: TC6 XML, version 2.01 (PLCopen, "XML Formats for IEC 61131-3").
#include <fmt/format.h>

#include <algorithm>
#include <map>
#include <set>

#include "plc_program.hpp"

namespace polypod::cell {
namespace {

std::string escaped(const std::string& text) {
  std::string out;
  for (const char c : text) {
    const auto u = static_cast<unsigned char>(c);
    if (c == '&')
      out += "&amp;";
    else if (c == '<')
      out += "&lt;";
    else if (c == '>')
      out += "&gt;";
    else if (c == '"')
      out += "&quot;";
    else
      out += (u < 0x20 && c != '\n') || u >= 0x7f ? ' ' : c;
  }
  return out;
}

class Xml {
 public:
  void open(const std::string& tag) {
    line("<" + tag + ">");
    open_.push_back(tag.substr(0, tag.find(' ')));
  }
  void close() {
    const std::string tag = open_.back();
    open_.pop_back();
    line("</" + tag + ">");
  }
  void line(const std::string& text) { out_ += std::string(2 * open_.size(), ' ') + text + "\n"; }
  /// Structured Text or words as the format wants them: in a paragraph of XHTML, white space as it is.
  void formatted(const std::string& tag, const std::string& text) {
    line(fmt::format("<{0}><xhtml:p>{1}</xhtml:p></{0}>", tag, escaped(text)));
  }
  [[nodiscard]] const std::string& text() const { return out_; }
  [[nodiscard]] std::size_t depth() const { return open_.size(); }

 private:
  std::string out_;
  std::vector<std::string> open_;
};

void variables(Xml& xml, const std::vector<PlcVariable>& all) {
  using Section = PlcVariable::Section;
  for (const auto& [section, tag] : {std::pair{Section::input, "inputVars"}, std::pair{Section::output, "outputVars"},
                                     std::pair{Section::local, "localVars"}}) {
    if (std::none_of(all.begin(), all.end(), [s = section](const PlcVariable& v) { return v.section == s; })) continue;
    xml.open(tag);
    for (const PlcVariable& v : all) {
      if (v.section != section) continue;
      xml.open(fmt::format("variable name=\"{}\"", v.name));
      xml.line(v.type == "BOOL" || v.type == "INT" ? fmt::format("<type><{}/></type>", v.type)
                                                   : fmt::format("<type><derived name=\"{}\"/></type>", v.type));
      if (!v.initial.empty())
        xml.line(fmt::format("<initialValue><simpleValue value=\"{}\"/></initialValue>", v.initial));
      if (!v.comment.empty()) xml.formatted("documentation", v.comment);
      xml.close();
    }
    xml.close();
  }
}

/// The chart of states as a sequential function chart. Each state is one step, drawn where a transition first leads to
/// it; further transitions to it end in jumps. Where several leave a state they begin at a divergence, the first with
/// the highest priority.
class Sfc {
 public:
  Sfc(Xml& xml, const StateChart& chart) : xml_(xml), chart_(chart) {}

  void write() {
    xml_.open("SFC");
    step(chart_.states.front(), -1, 0, 0);
    // States that nothing leads to would be lost: the chart of a cell has none.
    xml_.close();
  }

 private:
  static constexpr int kColumn = 400, kRow = 80;

  int next() { return ++last_; }
  void position(int column, int row) {
    xml_.line(fmt::format("<position x=\"{}\" y=\"{}\"/>", 100 + column * kColumn, 40 + row * kRow));
  }
  void comes_from(int id, const std::string& parameter = {}) {
    xml_.line(fmt::format("<connectionPointIn><connection refLocalId=\"{}\"{}/></connectionPointIn>", id,
                          parameter.empty() ? "" : fmt::format(" formalParameter=\"{}\"", parameter)));
  }

  void step(const std::string& state, int before, int column, int row) {
    drawn_.insert(state);
    const int id = next();
    xml_.open(
        fmt::format("step localId=\"{}\" name=\"{}\" initialStep=\"{}\"", id, state, before < 0 ? "true" : "false"));
    position(column, row);
    if (before >= 0) comes_from(before);
    xml_.line("<connectionPointOut formalParameter=\"sfc\"/>");
    xml_.line("<connectionPointOutAction formalParameter=\"action\"/>");
    xml_.close();
    const int block = next();
    xml_.open(fmt::format("actionBlock localId=\"{}\"", block));
    position(column, row);
    comes_from(id, "action");
    xml_.open(fmt::format("action localId=\"{}\" qualifier=\"N\"", next()));
    xml_.line("<relPosition x=\"0\" y=\"0\"/>");
    xml_.line(fmt::format("<reference name=\"In{}\"/>", state));
    xml_.close();
    xml_.close();
    std::vector<const Transition*> leave;
    for (const Transition& t : chart_.transitions)
      if (t.from == state) leave.push_back(&t);
    int from = id;
    std::string parameter = "sfc";
    const bool several = leave.size() > 1;
    if (several) {
      from = next();
      xml_.open(fmt::format("selectionDivergence localId=\"{}\"", from));
      position(column, ++row);
      comes_from(id, "sfc");
      for (std::size_t k = 0; k < leave.size(); ++k)
        xml_.line(fmt::format("<connectionPointOut formalParameter=\"branch{}\"/>", k + 1));
      xml_.close();
    }
    for (std::size_t k = 0; k < leave.size(); ++k) {
      const int at = next(), side = column + static_cast<int>(k);
      xml_.open(several ? fmt::format("transition localId=\"{}\" priority=\"{}\"", at, k + 1)
                        : fmt::format("transition localId=\"{}\"", at));
      position(side, row + 1);
      comes_from(from, several ? fmt::format("branch{}", k + 1) : parameter);
      xml_.line("<connectionPointOut/>");
      xml_.open("condition");
      xml_.open("inline name=\"\"");
      xml_.formatted("ST", in_block(leave[k]->condition));
      xml_.close();
      xml_.close();
      xml_.formatted("documentation", leave[k]->words);
      xml_.close();
      if (drawn_.contains(leave[k]->to)) {
        xml_.open(fmt::format("jumpStep localId=\"{}\" targetName=\"{}\"", next(), leave[k]->to));
        position(side, row + 2);
        comes_from(at);
        xml_.close();
      } else {
        step(leave[k]->to, at, side, row + 2);
      }
    }
  }

 public:
  /// Inside of the block the tasks of the machines are one input.
  static std::string in_block(const std::string& condition) {
    return condition.rfind("HoldersEmpty", 0) == 0 ? "HoldersEmpty AND MachinesIdle" : condition;
  }

 private:
  Xml& xml_;
  const StateChart& chart_;
  int last_ = 0;
  std::set<std::string> drawn_;
};

}  // namespace

std::string plcopen_xml(const Cell& cell) {
  using Section = PlcVariable::Section;
  const StateChart chart = state_chart(cell);
  PlcProgram program = plc_program(cell, [](const std::string& state) { return "States.In" + state; });
  Xml xml;
  xml.line("<?xml version=\"1.0\" encoding=\"utf-8\"?>");
  xml.open("project xmlns=\"http://www.plcopen.org/xml/tc6_0201\" xmlns:xhtml=\"http://www.w3.org/1999/xhtml\"");
  xml.line(
      "<fileHeader companyName=\"\" productName=\"Polypod\" productVersion=\"1\" "
      "creationDateTime=\"1970-01-01T00:00:00\"/>");
  xml.open(fmt::format("contentHeader name=\"{}\"", escaped(comment_text(cell.name))));
  xml.line(
      "<Comment>Sequence of the cell. A frame: bind inputs and outputs, and let the safety controller, not this "
      "program, stop the drives.</Comment>");
  xml.open("coordinateInfo");
  for (const char* language : {"fbd", "ld", "sfc"})
    xml.line(fmt::format("<{0}><scaling x=\"1\" y=\"1\"/></{0}>", language));
  xml.close();
  xml.close();
  xml.open("types");
  xml.line("<dataTypes/>");
  xml.open("pous");

  xml.open("pou name=\"CellStates\" pouType=\"functionBlock\"");
  std::vector<PlcVariable> block;
  const std::vector<std::string> inputs{"StartPressed", "StopPressed", "EndPressed",   "GuardsClosed",
                                        "Refilled",     "AllServed",   "HoldersEmpty", "MachinesIdle"};
  for (const std::string& name : inputs) block.push_back({Section::input, name, "BOOL", "", ""});
  for (const std::string& state : chart.states) block.push_back({Section::output, "In" + state, "BOOL", "", ""});
  xml.open("interface");
  variables(xml, block);
  xml.close();
  xml.open("body");
  Sfc(xml, chart).write();
  xml.close();
  xml.close();

  xml.open(fmt::format("pou name=\"{}\" pouType=\"program\"", program.name));
  program.variables.push_back({Section::local, "States", "CellStates", "", ""});
  xml.open("interface");
  variables(xml, program.variables);
  xml.close();
  xml.open("body");
  std::string text;
  for (const std::string& line : program.before) text += line + "\n";
  std::string idle;
  for (const Transition& t : chart.transitions) {
    const std::size_t tasks = t.condition.find(" AND ");
    if (t.condition.rfind("HoldersEmpty", 0) == 0 && tasks != std::string::npos) idle = t.condition.substr(tasks + 5);
  }
  text += "\nStates(";
  for (const std::string& name : inputs)
    text += fmt::format("{}{} := {}", name == inputs.front() ? "" : ", ", name, name == "MachinesIdle" ? idle : name);
  text += ");\n";
  for (const std::string& line : program.after) text += line + "\n";
  xml.formatted("ST", text);
  xml.close();
  xml.close();

  xml.close();
  xml.close();
  xml.open("instances");
  xml.open("configurations");
  xml.open("configuration name=\"Controller\"");
  xml.open("resource name=\"Cpu\"");
  xml.open("task name=\"Cycle\" interval=\"T#10ms\" priority=\"1\"");
  xml.line(fmt::format("<pouInstance name=\"Sequence\" typeName=\"{}\"/>", program.name));
  while (xml.depth() > 0) xml.close();
  return xml.text();
}

}  // namespace polypod::cell
