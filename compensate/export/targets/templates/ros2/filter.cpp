// {{ title | c_comment }}: filters that give {{ estimate.name | c_comment }} for {{ reading.name | c_comment }}.
//
// Two plugins for chains of the package "filters": one for a number, one for the axes of a wrench. README.md lists
// their parameters. A filter keeps one compensator for each axis; nothing is allocated after configure().

#include <array>
#include <atomic>
#include <chrono>
#include <cmath>
#include <memory>
#include <string>
#include <thread>

#include <filters/filter_base.hpp>
#include <geometry_msgs/msg/wrench_stamped.hpp>
#include <pluginlib/class_list_macros.hpp>
#include <rclcpp/rclcpp.hpp>
#include <std_msgs/msg/float64.hpp>
#include <std_srvs/srv/trigger.hpp>

#include "{{ stem }}.h"

namespace {{ stem }}
{

/// The service that resets a filter, and the topic of its condition: a node of its own, because a filter has none.
class Side
{
public:
    std::atomic<bool> reset{false};
    std::atomic<double> condition{NAN};

    ~Side()
    {
        if (executor_) {
            executor_->cancel();
            thread_.join();
        }
    }

    void open(const std::string &name, const std::string &service, const std::string &topic)
    {
        if (executor_ || (service.empty() && topic.empty())) {
            return;
        }
        node_ = std::make_shared<rclcpp::Node>(name);
        if (!service.empty()) {
            service_ = node_->create_service<std_srvs::srv::Trigger>(
                service, [this](
                             const std::shared_ptr<std_srvs::srv::Trigger::Request>,
                             std::shared_ptr<std_srvs::srv::Trigger::Response> response) {
                    reset = true;
                    response->success = true;
                    response->message = "reset before the next reading";
                });
        }
        if (!topic.empty()) {
            subscription_ = node_->create_subscription<std_msgs::msg::Float64>(
                topic, 1, [this](const std_msgs::msg::Float64 &said) { condition = said.data; });
        }
        executor_ = std::make_unique<rclcpp::executors::SingleThreadedExecutor>();
        executor_->add_node(node_);
        thread_ = std::thread([this] { executor_->spin(); });
    }

private:
    rclcpp::Node::SharedPtr node_;
    rclcpp::Service<std_srvs::srv::Trigger>::SharedPtr service_;
    rclcpp::Subscription<std_msgs::msg::Float64>::SharedPtr subscription_;
    std::unique_ptr<rclcpp::executors::SingleThreadedExecutor> executor_;
    std::thread thread_;
};

/// A compensator, and how what comes in becomes its reading.
struct Axis
{
    bool enabled = false;
    double scale = 1.0, offset = 0.0;
    {{ stem }}_state state;

    /// `seconds` since the last call.
    double step(double seconds, double given, double condition)
    {
        double estimate = NAN;
        (void)condition;
        (void){{ stem }}_step(
            &state, seconds * {{ per_second | exact }}, scale * given + offset, {% if condition %}condition, {% endif %}&estimate, nullptr);
        return estimate;
    }
};

/// What both filters share: parameters, time and reset.
template <typename T>
class Base : public filters::FilterBase<T>
{
protected:
    bool open()
    {
        std::string service, topic;
        read("reset_service", service);
        read("condition_topic", topic);
        read("period", period_);
{% if condition %}
        double condition = NAN;
        read("condition", condition);
        side_.condition = condition;
{% endif %}
        side_.open(this->filter_name_.empty() ? "{{ stem }}" : this->filter_name_ + "_side", service, topic);
        {{ stem }}_state tried;
        return {{ stem }}_self_test(&tried) == 0;
    }

    void open(Axis &axis, const std::string &prefix, bool enabled)
    {
        axis.enabled = enabled;
        read(prefix + "enabled", axis.enabled);
        read(prefix + "scale", axis.scale);
        read(prefix + "offset", axis.offset);
        {{ stem }}_reset(&axis.state);
    }

    /// Seconds since the last reading, `now` being its stamp or 0 without one.
    double passed(double now)
    {
        if (now == 0.0) {
            now = std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
        }
        double seconds = period_ > 0.0 ? period_ : begun_ ? now - last_ : 0.0;
        last_ = now;
        begun_ = true;
        return seconds;
    }

    Side side_;

private:
    template <typename P>
    void read(const std::string &name, P &value)
    {
        P given = value;
        if (this->getParam(name, given)) {
            value = given;
        }
    }

    double period_ = 0.0, last_ = 0.0;
    bool begun_ = false;
};

/// For a chain of numbers.
class Scalar : public Base<double>
{
public:
    bool configure() override
    {
        this->open(axis_, "", true);
        return this->open();
    }

    bool update(const double &in, double &out) override
    {
        if (side_.reset.exchange(false)) {
            {{ stem }}_reset(&axis_.state);
        }
        double seconds = this->passed(0.0);
        out = axis_.enabled ? axis_.step(seconds, in, side_.condition) : in;
        return true;
    }

private:
    Axis axis_;
};

/// For a chain of wrenches: each axis that is enabled has a compensator of its own, the others pass.
class Wrench : public Base<geometry_msgs::msg::WrenchStamped>
{
public:
    bool configure() override
    {
        static const char *const names[6] = {"force.x.",  "force.y.",  "force.z.",
                                             "torque.x.", "torque.y.", "torque.z."};
        for (std::size_t k = 0; k < 6; ++k) {
            this->open(axes_[k], names[k], false);
        }
        return this->open();
    }

    bool update(
        const geometry_msgs::msg::WrenchStamped &in, geometry_msgs::msg::WrenchStamped &out) override
    {
        bool reset = side_.reset.exchange(false);
        double now = static_cast<double>(in.header.stamp.sec) + 1e-9 * in.header.stamp.nanosec;
        double seconds = this->passed(now);
        out = in;
        double *const places[6] = {&out.wrench.force.x,  &out.wrench.force.y,  &out.wrench.force.z,
                                   &out.wrench.torque.x, &out.wrench.torque.y, &out.wrench.torque.z};
        for (std::size_t k = 0; k < 6; ++k) {
            if (reset) {
                {{ stem }}_reset(&axes_[k].state);
            }
            if (axes_[k].enabled) {
                *places[k] = axes_[k].step(seconds, *places[k], side_.condition);
            }
        }
        return true;
    }

private:
    std::array<Axis, 6> axes_;
};

}  // namespace {{ stem }}

PLUGINLIB_EXPORT_CLASS({{ stem }}::Scalar, filters::FilterBase<double>)
PLUGINLIB_EXPORT_CLASS({{ stem }}::Wrench, filters::FilterBase<geometry_msgs::msg::WrenchStamped>)
