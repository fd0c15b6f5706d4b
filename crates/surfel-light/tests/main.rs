//! Stored light against closed forms.

mod closed_forms;
