//! Tests of stored light against closed forms.

mod closed_forms;
